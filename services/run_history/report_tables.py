"""Tables of a report: heads and rows of text, for pages; and of plain values, for CSV and Parquet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import mean

from services.run_history.reception_survey import Reception
from services.run_history.report_reasons import in_language
from services.run_history.report_words import Language, said
from services.run_history.run_report import RunReport, SectionReport
from services.run_history.run_statistics import local_hour

Cell = str | float | int | bool | None


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class Columns:
    """Rows of values under plain names."""

    name: str
    heads: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


def name_of(section: SectionReport) -> str:
    """Section, direction and series for a heading."""
    return f"{section.group.start} → {section.group.end} · {section.group.series}"


def margin_table(report: RunReport, language: Language) -> Table:
    """One line a group: the article's Figure 6 as a table."""
    within = report.sections[0].margin.within_s if report.sections and report.sections[0].margin else 10.0
    keys = ("section", "series", "runs", "reference")
    heads = [said(key, language) for key in keys]
    heads += [said("within", language, s=within)]
    heads += [said(key, language) for key in ("mean", "minimum", "margin", "interval", "best", "remark")]
    return Table(tuple(heads), tuple(_margin_row(one, language) for one in report.sections))


def _margin_row(section: SectionReport, language: Language) -> tuple[str, ...]:
    group, margin = section.group, section.margin
    first = (f"{group.start} → {group.end}", group.series, str(len(group.rows)))
    if margin is None:
        return (*first, *("–",) * 7, said("none_counts", language))
    remarks = []
    if margin.small:
        remarks.append(said("small", language))
    if margin.reference == "median":
        remarks.append(said("no_schedule", language))
    return (
        *first,
        f"{margin.reference_s:.0f} s",
        str(len(margin.rows)),
        f"{margin.mean:.3f}",
        f"{margin.minimum:.3f}",
        f"{100 * margin.margin:.1f} %",
        f"{100 * margin.low:.1f}–{100 * margin.high:.1f} %" if len(margin.rows) > 1 else "–",
        margin.best.run_id,
        "; ".join(remarks),
    )


def energy_table(report: RunReport, language: Language) -> Table:
    """Mean traction, regeneration and auxiliaries of each group, and what they come to from the line."""
    keys = ("section", "series", "runs", "traction_kwh", "regenerated_kwh", "auxiliaries_kwh", "net_kwh")
    rows = []
    for section in report.sections:
        legs = section.group.rows
        if not legs:
            continue
        traction = mean(row.energy_kwh for row in legs)
        back = _mean([row.regenerated_kwh for row in legs])
        beside = _mean([row.auxiliaries_kwh for row in legs])
        net = None if back is None or beside is None else traction - back + beside
        first = (f"{section.group.start} → {section.group.end}", section.group.series, str(len(legs)))
        rows.append((*first, f"{traction:.2f}", *("–" if one is None else f"{one:.2f}" for one in (back, beside, net))))
    return Table(tuple(said(key, language) for key in keys), tuple(rows))


def _mean(values: Sequence[float | None]) -> float | None:
    """Mean; None where one is not told."""
    told = [one for one in values if one is not None]
    return mean(told) if told and len(told) == len(values) else None


def legs_table(section: SectionReport, report: RunReport, language: Language, most: int = 40) -> Table:
    """The first runs of a group, one a line."""
    keys = ("run", "hour", "running_time", "traction_kwh", "energy", "regenerated_kwh", "auxiliaries_kwh", "quality")
    rows = []
    for row, share in list(zip(section.group.rows, section.group.energies, strict=True))[:most]:
        rows.append(
            (
                row.run_id,
                f"{int(local_hour(row.departure_s, report.selection.zone))}",
                f"{row.running_time_s:.0f}",
                with_sigma(row.energy_kwh, row.energy_sigma_kwh),
                f"{share:.3f}",
                with_sigma(row.regenerated_kwh, row.regenerated_sigma_kwh),
                with_sigma(row.auxiliaries_kwh, row.auxiliaries_sigma_kwh),
                f"{row.quality:.2f}",
            )
        )
    return Table(tuple(said(key, language) for key in keys), tuple(rows))


def with_sigma(value: float | None, sigma: float | None) -> str:
    """An energy with its standard deviation; a dash where a table did not tell it."""
    if value is None:
        return "–"
    return f"{value:.2f}" if sigma is None else f"{value:.2f} ± {sigma:.2f}"


def left_out_line(section: SectionReport, language: Language) -> str:
    """Why legs of a group do not count, with their number."""
    comma, colon = (", ", ": ") if language == "en" else ("、", ":")
    return comma.join(f"{in_language(reason, language)}{colon}{count}" for reason, count in section.group.left_out)


def reception_table(reception: Sequence[Reception], language: Language, most: int = 20) -> Table:
    """The worst stretches, in order of the line."""
    worst = sorted(reception, key=lambda one: (-one.missing_s, -one.without_speed_share, one.start_axis_m))[:most]
    keys = ("stretch", "fixes", "without_speed", "missing", "longest")
    return Table(
        tuple(said(key, language) for key in keys),
        tuple(
            (
                f"{one.start_axis_m / 1000:.2f}–{one.end_axis_m / 1000:.2f}",
                str(one.fixes),
                f"{100 * one.without_speed_share:.1f}",
                f"{one.missing_s:.0f}",
                f"{one.longest_gap_s:.0f}",
            )
            for one in sorted(worst, key=lambda one: one.start_axis_m)
            if one.missing_s > 0.0 or one.without_speed > 0
        ),
    )


def margin_columns(report: RunReport) -> Columns:
    """The margins as values."""
    heads = "from to direction series runs reference_s reference within_s runs_within mean minimum margin"
    heads += " margin_low margin_high small_sample best_run"
    rows: list[tuple[Cell, ...]] = []
    for one in report.sections:
        g, m = one.group, one.margin
        first: tuple[Cell, ...] = (g.start, g.end, g.direction, g.series, len(g.rows))
        if m is None:
            rows.append((*first, *(None,) * 9, True, None))
            continue
        taken: tuple[Cell, ...] = (m.reference_s, m.reference, m.within_s, len(m.rows))
        rows.append((*first, *taken, m.mean, m.minimum, m.margin, m.low, m.high, m.small, m.best.run_id))
    return Columns("margins", tuple(heads.split()), tuple(rows))


def run_columns(report: RunReport) -> Columns:
    """The runs that count as values; with pseudonyms, the hour of departure alone."""
    heads = "run from to direction series departure_hour departure_unix_s running_time_s"
    heads += " energy_kwh energy_sigma_kwh energy_normalised regenerated_kwh regenerated_sigma_kwh"
    heads += " auxiliaries_kwh auxiliaries_sigma_kwh quality"
    rows: list[tuple[Cell, ...]] = []
    for one in report.sections:
        for row, share in zip(one.group.rows, one.group.energies, strict=True):
            hour = int(local_hour(row.departure_s, report.selection.zone))
            when = None if report.pseudonyms else row.departure_s
            which: tuple[Cell, ...] = (row.run_id, row.start, row.end, row.direction, row.series, hour, when)
            energy: tuple[Cell, ...] = (row.energy_kwh, row.energy_sigma_kwh, float(share))
            apart: tuple[Cell, ...] = (row.regenerated_kwh, row.regenerated_sigma_kwh)
            apart += (row.auxiliaries_kwh, row.auxiliaries_sigma_kwh)
            rows.append((*which, row.running_time_s, *energy, *apart, row.quality))
    return Columns("runs", tuple(heads.split()), tuple(rows))


def reception_columns(report: RunReport) -> Columns:
    """The reception survey as values."""
    heads = ("start_axis_m", "end_axis_m", "fixes", "without_speed", "missing_s", "longest_gap_s")
    rows = tuple(
        (one.start_axis_m, one.end_axis_m, one.fixes, one.without_speed, one.missing_s, one.longest_gap_s)
        for one in report.reception
    )
    return Columns("reception", heads, rows)
