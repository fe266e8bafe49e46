"""What a report tells of a section and of a run, line by line, in English and Japanese."""

from __future__ import annotations

from typing import Final

from services.run_history.driving_advice import advice_of
from services.run_history.report_reasons import in_language
from services.run_history.report_words import Language, said
from services.run_history.run_report import SectionReport
from services.run_history.run_rows import RunRow
from services.run_history.section_driving import Driving, same_leg
from services.run_history.speed_trace import KMH, SpeedTrace

OVER_MPS: Final = 2.0 / 3.6
"""Speeds are known this well; a limit exceeded by less is not told."""


def difference_lines(section: SectionReport, language: Language) -> list[str]:
    """What the energy-saving run does differently, how hills spread, where the log leaves its reference."""
    driving = section.driving
    if driving is None:
        return []
    lines = []
    d = driving.difference
    if d is not None:
        lines.append(said("top", language, best=KMH * d.top_mps, others=KMH * d.top_others_mps))
        if d.limited_mps is not None and d.limited_others_mps is not None:
            lines.append(
                said("limited", language, best=KMH * d.limited_mps, others=KMH * d.limited_others_mps),
            )
        lines.append(said("approach", language, best=KMH * d.approach_mps, others=KMH * d.approach_others_mps))
        lines.append(said("again", language, best=d.reaccelerations, others=d.reaccelerations_others))
    return [*lines, *_optimum_lines(section, driving, language), *_place_lines(driving, language)]


def _optimum_lines(section: SectionReport, driving: Driving, language: Language) -> list[str]:
    if driving.no_optimum:
        return [said("no_optimum", language, why=in_language(driving.no_optimum, language))]
    if driving.optimum is None or section.margin is None:
        return []
    best_kwh = section.margin.best.energy_kwh
    kwh = driving.optimum.traction_kwh
    share = 100.0 * (kwh / best_kwh - 1.0)
    told = said("optimum_is", language, time=driving.optimum.running_time_s, kwh=kwh, share=share)
    return [told, *_limit_lines(driving, language)]


def _limit_lines(driving: Driving, language: Language) -> list[str]:
    """Under which limits the optimum was found, where they are not the stated ones."""
    limits = driving.limits
    if limits is None:
        return []
    lines = []
    if limits.observed_share > 0.0:
        lines.append(said("observed", language, share=100.0 * limits.observed_share))
    if limits.over_mps > OVER_MPS:
        lines.append(said("over_limit", language, by=KMH * limits.over_mps))
    if limits.beyond:
        lines.append(said("more_able", language, what=", ".join(limits.beyond)))
    return lines


def advice_lines(section: SectionReport, language: Language) -> list[str]:
    """How the optimum of a section is driven; places count from the departure station."""
    driving = section.driving
    if driving is None or driving.optimum is None:
        return []
    way = driving.way
    return [
        said(
            f"advise_{one.what}",
            language,
            at=max(way.sign * (one.from_axis_m - way.start_axis_m), 0.0) / 1000.0,
            from_kmh=one.from_kmh,
            until_kmh=one.until_kmh,
            length=one.length_m,
            time=one.until_s - one.from_s,
        )
        for one in advice_of(driving.optimum)
    ]


def _place_lines(driving: Driving, language: Language) -> list[str]:
    hills = [
        said(
            "hill",
            language,
            a=hill.start_m / 1000.0,
            b=hill.end_m / 1000.0,
            low=KMH * float(hill.peaks_mps.min()),
            high=KMH * float(hill.peaks_mps.max()),
            spread=KMH * hill.spread_mps,
        )
        for hill in driving.hills
    ]
    leaves = [
        said(
            "leaves",
            language,
            a=one.start_m / 1000.0,
            b=one.end_m / 1000.0,
            runs=one.runs,
            of=one.of_runs,
            most=KMH * one.largest_mps,
        )
        for one in driving.departures
    ]
    return [*hills, *leaves]


def row_of_trace(section: SectionReport, trace: SpeedTrace) -> RunRow:
    """Row of a trace of the same section."""
    return next(row for row in section.group.rows if same_leg(trace, row))


def sheet_lines(section: SectionReport, run: int, language: Language) -> list[str]:
    """What one driver may take from one run (a number of `driving.traces`), against the energy-saving run."""
    driving, margin = section.driving, section.margin
    if driving is None:
        return []
    lines = []
    trace = driving.traces[run]
    if margin is not None and driving.best is not None and run != driving.best:
        row = row_of_trace(section, trace)
        share = 100.0 * (row.energy_kwh / margin.best.energy_kwh - 1.0)
        lines.append(
            said("against", language, time=row.running_time_s - margin.best.running_time_s, energy=share),
        )
        top = KMH * float(trace.speed_mps.max())
        best = KMH * float(driving.traces[driving.best].speed_mps.max())
        if top > best + 1.0:
            lines.append(said("top_lower", language, by=top - best, best=best))
    lines += [
        said(
            "again_at",
            language,
            at=dip.at_m / 1000.0,
            from_kmh=KMH * dip.from_mps,
            low=KMH * dip.low_mps,
            to=KMH * dip.to_mps,
        )
        for dip in driving.again[run]
    ]
    return lines
