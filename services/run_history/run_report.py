"""Everything that a report shows, put together from rows, traces and optimum; no words and no pictures yet."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol

from schemas.line import Station
from services.line.alignment import Alignment
from services.run_history.patterns import Pattern, patterns_of
from services.run_history.pseudonym import pseudonym
from services.run_history.reception_survey import Reception
from services.run_history.reference_departure import departures
from services.run_history.run_rows import RunRow
from services.run_history.run_statistics import Group, Selection, groups_of
from services.run_history.saving_margin import WITHIN_S, SavingMargin, reference_time, saving_margin
from services.run_history.section_driving import Driving, driving_of, same_leg, way_between
from services.run_history.speed_trace import SpeedTrace
from services.run_history.vehicle import Vehicle

MOST_JOURNEYS: Final = 600
"""Legs of the time–distance diagram."""


@dataclass(frozen=True, slots=True)
class SectionReport:
    """A group with everything about it."""

    group: Group
    margin: SavingMargin | None
    patterns: tuple[Pattern, ...]
    driving: Driving | None
    """None without logs."""


@dataclass(frozen=True, slots=True)
class Journey:
    """A leg of the time–distance diagram."""

    trace: SpeedTrace
    start_axis_m: float
    up: bool


@dataclass(frozen=True, slots=True)
class RunReport:
    """The whole report."""

    sections: tuple[SectionReport, ...]
    """Up along the line, then down; by name without a line."""
    sheets: tuple[tuple[SectionReport, int], ...]
    """Legs with a crew sheet, each the number of a trace: run by run in order of time."""
    selection: Selection
    runs: int
    legs: int
    counted: int
    pseudonyms: bool
    reception: tuple[Reception, ...]
    journeys: tuple[Journey, ...]
    """Legs of the selection, the first six hundred."""
    stations: tuple[tuple[str, float], ...]
    """Of the line: name and place; empty without a line."""
    vehicle: Vehicle | None
    notes: tuple[str, ...]


class Traces(Protocol):
    """Speeds of legs by section, in memory or elsewhere."""

    def of(self, start: str, end: str) -> Sequence[SpeedTrace]:
        """Traces of all legs from one station to another (names), those that do not count too."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What logs add to the table."""

    way: Alignment
    vehicle: Vehicle
    traces: Traces
    reference: Traces | None = None
    """Monitor records of the same legs."""
    reception: tuple[Reception, ...] = ()


@dataclass(frozen=True, slots=True)
class Wishes:
    """What a report is to hold."""

    selection: Selection
    within_s: float = WITHIN_S
    sheets: int = 10
    """Most crew sheets."""


def report_of(
    rows: Sequence[RunRow], wishes: Wishes, evidence: Evidence | None, salt: bytes | None, notes: Sequence[str] = ()
) -> RunReport:
    """Report of rows, with driving where there are logs. `salt` None: run ids stay as they are.

    One section's speeds are in memory at a time. Raises ZoneInfoNotFoundError for an unknown time zone.
    """
    named = [replace(row, run_id=_named(row.run_id, salt)) for row in rows]
    places = {one.name: one for one in evidence.way.stations} if evidence else {}
    groups = sorted(groups_of(named, wishes.selection), key=lambda one: _along(one, places))
    chosen = _sheet_rows(groups, wishes.sheets)
    sections = tuple(_section(one, evidence, places, wishes, chosen, salt) for one in groups)
    return RunReport(
        sections,
        _sheets(sections, chosen),
        wishes.selection,
        len({row.run_id for row in named}),
        len(named),
        sum(len(one.rows) for one in groups),
        salt is not None,
        evidence.reception if evidence else (),
        tuple(_journeys(groups, evidence, places, wishes.selection, salt)),
        tuple((one.name, one.axis_m) for one in places.values()),
        evidence.vehicle if evidence else None,
        tuple(notes),
    )


def _named(run_id: str, salt: bytes | None) -> str:
    return run_id if salt is None else pseudonym(run_id, salt)


def _along(group: Group, places: dict[str, Station]) -> tuple[bool, float, float, str, str, str]:
    """Order of sections: up along the line, then down."""
    start, end = places.get(group.start), places.get(group.end)
    sign = 1.0 if group.direction == "up" else -1.0
    where = (sign * start.axis_m, sign * end.axis_m) if start and end else (0.0, 0.0)
    return (group.direction == "down", *where, group.start, group.end, group.series)


def _sheet_rows(groups: Iterable[Group], most: int) -> list[RunRow]:
    """Rows that get a sheet: the legs of the first run, then those of the next."""
    rows = [row for group in groups for row in group.rows]
    begins: dict[str, float] = {}
    for row in rows:
        begins[row.run_id] = min(begins.get(row.run_id, row.departure_s), row.departure_s)
    return sorted(rows, key=lambda row: (begins[row.run_id], row.run_id, row.departure_s))[:most]


def _sheets(sections: Sequence[SectionReport], chosen: Sequence[RunRow]) -> tuple[tuple[SectionReport, int], ...]:
    found = []
    for row in chosen:
        for section in sections:
            group = section.group
            if section.driving is None or (group.start, group.end, group.series) != (row.start, row.end, row.series):
                continue
            found += [(section, k) for k, one in enumerate(section.driving.traces) if same_leg(one, row)]
    return tuple(found)


def _section(
    group: Group,
    evidence: Evidence | None,
    places: dict[str, Station],
    wishes: Wishes,
    chosen: Sequence[RunRow],
    salt: bytes | None,
) -> SectionReport:
    margin = saving_margin(group, wishes.within_s)
    patterns = patterns_of(group.rows, reference_time(group)[0]) if group.rows else ()
    start, end = places.get(group.start), places.get(group.end)
    if evidence is None or start is None or end is None or not group.rows:
        return SectionReport(group, margin, patterns, None)
    traces = _traces_of(group, _all_named(evidence.traces.of(group.start, group.end), salt))
    if not traces:
        return SectionReport(group, margin, patterns, None)
    way = way_between(evidence.way, start, end)
    other = _all_named(evidence.reference.of(group.start, group.end), salt) if evidence.reference else []
    left = departures(_pairs(traces, other), float(way.grid_m[-1]))
    wanted = [one.row for one in patterns if one.row is not None]
    wanted += [row for row in chosen if (row.start, row.end, row.series) == (group.start, group.end, group.series)]
    best = None if margin is None else margin.best
    driving = driving_of(traces, way, evidence.way, evidence.vehicle, best, wanted, left)
    return SectionReport(group, margin, patterns, driving)


def _all_named(traces: Sequence[SpeedTrace], salt: bytes | None) -> list[SpeedTrace]:
    return [replace(one, run_id=_named(one.run_id, salt)) for one in traces]


def _traces_of(group: Group, traces: Sequence[SpeedTrace]) -> list[SpeedTrace]:
    """Traces of a group's rows, in the order of these."""
    by_run: dict[str, list[SpeedTrace]] = {}
    for one in traces:
        by_run.setdefault(one.run_id, []).append(one)
    found = (next((one for one in by_run.get(row.run_id, ()) if same_leg(one, row)), None) for row in group.rows)
    return [one for one in found if one is not None]


def _pairs(traces: Sequence[SpeedTrace], other: Sequence[SpeedTrace]) -> list[tuple[SpeedTrace, SpeedTrace]]:
    """Each trace with the reference of the same run and leg, whose clock may be another."""
    by_run: dict[str, list[SpeedTrace]] = {}
    for one in other:
        by_run.setdefault(one.run_id, []).append(one)
    return [
        (log, one)
        for log in traces
        for one in by_run.get(log.run_id, ())
        if abs(one.departure_s - log.departure_s) < float(log.time_s[-1]) / 2.0
    ]


def _journeys(
    groups: Sequence[Group],
    evidence: Evidence | None,
    places: dict[str, Station],
    selection: Selection,
    salt: bytes | None,
) -> list[Journey]:
    """Legs within the hours, the first ones of all sections; those that do not count are trains as well."""
    found: list[Journey] = []
    if evidence is None:
        return found
    sections = dict.fromkeys((one.start, one.end) for one in groups)
    for start, end in sections:
        if start not in places or end not in places:
            continue
        up = places[end].axis_m > places[start].axis_m
        legs = [one for one in evidence.traces.of(start, end) if selection.holds(one.departure_s)]
        legs = sorted(legs, key=lambda one: one.departure_s)[: max(1, MOST_JOURNEYS // len(sections))]
        found += [Journey(one, places[start].axis_m, up) for one in _all_named(legs, salt)]
    return found
