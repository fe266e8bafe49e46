"""A report as a sequence of headings, lines, tables and pictures, the same for every form of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final

from matplotlib.figure import Figure

from services.run_history.report_lines import advice_lines, difference_lines, row_of_trace, sheet_lines
from services.run_history.report_reasons import in_language
from services.run_history.report_tables import (
    Table,
    energy_table,
    left_out_line,
    legs_table,
    margin_table,
    name_of,
    reception_table,
    with_sigma,
)
from services.run_history.report_words import Language, said
from services.run_history.run_plot import crew_sheet, distributions, overlay, patterns
from services.run_history.run_report import RunReport, SectionReport
from services.run_history.run_statistics import local_hour
from services.run_history.time_distance_plot import reception_strip, time_distance

MOST_NOTES: Final = 20


@dataclass(frozen=True, slots=True)
class Block:
    """One of a heading, lines, a table, a picture."""

    heading: str = ""
    level: int = 2
    lines: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    """Lines of a second column."""
    table: Table | None = None
    picture: Callable[[], Figure] | None = None
    caption: str = ""


def blocks_of(report: RunReport, language: Language) -> Iterator[Block]:
    """Blocks in order; pictures are drawn when asked for."""
    yield Block(heading=said("title", language), level=1)
    chosen = report.selection
    summary = said(
        "summary",
        language,
        runs=report.runs,
        legs=report.legs,
        counted=report.counted,
        from_h=chosen.from_h,
        until_h=chosen.until_h,
        zone=chosen.zone,
    )
    lines = [said("estimate", language), said("upper_limit", language), summary]
    if report.pseudonyms:
        lines.append(said("pseudonyms", language))
    yield Block(lines=tuple(lines))
    yield Block(heading=said("margin_title", language))
    yield Block(table=margin_table(report, language))
    energies = energy_table(report, language)
    if energies.rows:
        yield Block(heading=said("energy_title", language))
        yield Block(lines=(said("energy_told", language),))
        yield Block(table=energies)
    for section in report.sections:
        yield from _section(section, report, language)
    if report.journeys:
        yield Block(heading=said("diagram", language))
        yield Block(picture=lambda: time_distance(report, language), caption=said("diagram", language))
    if report.reception:
        yield Block(heading=said("reception", language))
        yield Block(picture=lambda: reception_strip(report.reception, language), caption=said("reception", language))
        table = reception_table(report.reception, language)
        if table.rows:
            yield Block(table=table)
    yield from _sheets(report, language)
    if report.notes:
        more = len(report.notes) - MOST_NOTES
        yield Block(heading=said("notes", language))
        told = tuple(in_language(note, language) for note in report.notes[:MOST_NOTES])
        yield Block(lines=(*told, *((said("more", language, count=more),) if more > 0 else ())))


def _section(section: SectionReport, report: RunReport, language: Language) -> Iterator[Block]:
    name = name_of(section)
    yield Block(heading=f"{name} ({said(section.group.direction, language)})")
    if section.group.left_out:
        yield Block(lines=(f"{said('left_out', language)}: {left_out_line(section, language)}",))
    if section.driving is not None:
        yield Block(
            picture=lambda: overlay(section, language),
            caption=f"{said('overlay', language)}: {name}",
        )
        advice = advice_lines(section, language)
        beside = (f"{said('advice', language)}:", *advice) if advice else ()
        yield Block(lines=tuple(difference_lines(section, language)), beside=beside)
        if any(one.row is not None for one in section.patterns):
            yield Block(
                picture=lambda: patterns(section, language),
                caption=f"{said('overlay', language)}: {name}",
            )
    if section.group.rows:
        yield Block(
            picture=lambda: distributions(section, language),
            caption=f"{said('scatter', language)}: {name}",
        )
        yield Block(heading=f"{said('legs_title', language)}: {name}", level=3)
        yield Block(table=legs_table(section, report, language))


def _sheets(report: RunReport, language: Language) -> Iterator[Block]:
    for section, run in report.sheets:
        if section.driving is None:
            continue
        row = row_of_trace(section, section.driving.traces[run])
        yield Block(heading=f"{said('sheet', language)}: {row.run_id}, {name_of(section)}")
        yield Block(
            picture=partial(crew_sheet, section, run, language), caption=f"{said('sheet', language)}: {row.run_id}"
        )
        facts = said(
            "sheet_facts",
            language,
            hour=int(local_hour(row.departure_s, report.selection.zone)),
            time=f"{row.running_time_s:.0f}" + _of(row.scheduled_s),
            traction=with_sigma(row.energy_kwh, row.energy_sigma_kwh),
            share=f"{section.group.energies[section.group.rows.index(row)]:.3f}",
        )
        apart = said(
            "sheet_apart",
            language,
            regenerated=with_sigma(row.regenerated_kwh, row.regenerated_sigma_kwh),
            auxiliaries=with_sigma(row.auxiliaries_kwh, row.auxiliaries_sigma_kwh),
        )
        yield Block(lines=(facts, apart, *sheet_lines(section, run, language)))


def _of(scheduled_s: float | None) -> str:
    return "" if scheduled_s is None else f" / {scheduled_s:.0f}"
