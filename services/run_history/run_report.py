"""Everything that a report shows, put together from rows, traces and optimum; no words and no pictures yet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.line import Station
from services.line.alignment import Alignment
from services.run_history.driving_difference import (
    Difference,
    Hill,
    Reacceleration,
    difference_of,
    hills_of,
    reaccelerations,
)
from services.run_history.optimum import Optimum, OptimumError, Section, optimum, section_between
from services.run_history.patterns import Pattern, patterns_of
from services.run_history.pseudonym import pseudonym
from services.run_history.reception_survey import Reception
from services.run_history.reference_departure import Departure, departures
from services.run_history.run_analysis import LegRun
from services.run_history.run_rows import RunRow
from services.run_history.run_statistics import Group, Selection, groups_of
from services.run_history.saving_margin import WITHIN_S, SavingMargin, reference_time, saving_margin
from services.run_history.speed_trace import SpeedTrace, grid_over, population, trace_of
from services.run_history.vehicle import Vehicle

Floats = NDArray[np.float64]
SAME_LEG_S: Final = 5.0
"""Departures of one leg, once from the table and once from the log, differ by rounding alone; by less than a leg."""
OBSERVED_CELLS: Final = 10
BESIDE_M: Final = 300.0


@dataclass(frozen=True, slots=True)
class Way:
    """The section under a group's runs. Arrays have shape (n,)."""

    grid_m: Floats
    limit_mps: Floats
    """inf where none is known."""
    gradient_permille: Floats
    """Positive uphill in the direction of running."""
    stations: tuple[tuple[str, float], ...]
    """Name and way from the departure station."""


@dataclass(frozen=True, slots=True)
class Driving:
    """What the speeds of a group's runs tell; run k of `traces` is row k of `speeds_mps`."""

    traces: tuple[SpeedTrace, ...]
    speeds_mps: Floats
    way: Way
    hills: tuple[Hill, ...]
    again: tuple[tuple[Reacceleration, ...], ...]
    difference: Difference | None
    """Of the representative run; None where there is none, or no trace of it."""
    best: int | None
    optimum: Optimum | None
    """In the running time of the representative run."""
    no_optimum: str
    """Why there is none."""
    limits_observed: bool
    """No limit is known here: the optimum keeps to the highest speed that any run had about each place."""
    departures: tuple[Departure, ...]


@dataclass(frozen=True, slots=True)
class SectionReport:
    """A group with everything about it."""

    group: Group
    margin: SavingMargin | None
    patterns: tuple[Pattern, ...]
    driving: Driving | None
    """None without logs."""


@dataclass(frozen=True, slots=True)
class RunReport:
    """The whole report."""

    sections: tuple[SectionReport, ...]
    selection: Selection
    runs: int
    legs: int
    counted: int
    pseudonyms: bool
    reception: tuple[Reception, ...]
    journeys: tuple[tuple[SpeedTrace, float, bool], ...]
    """Every leg of the selection with the axis place of its departure and whether it runs up."""
    stations: tuple[tuple[str, float], ...]
    """Of the line: name and place; empty without a line."""
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Evidence:
    """What logs add to the table."""

    way: Alignment
    vehicle: Vehicle
    legs: tuple[LegRun, ...]
    reference: tuple[LegRun, ...] = ()
    reception: tuple[Reception, ...] = ()


def report_of(
    rows: Sequence[RunRow],
    selection: Selection,
    evidence: Evidence | None,
    salt: bytes | None,
    within_s: float = WITHIN_S,
    notes: Sequence[str] = (),
) -> RunReport:
    """Report of rows, with driving where there are logs. `salt` None: run ids stay as they are.

    Raises ZoneInfoNotFoundError for an unknown time zone.
    """
    named = [replace(row, run_id=_named(row.run_id, salt)) for row in rows]
    groups = groups_of(named, selection)
    legs = _by_section(evidence.legs if evidence else (), salt)
    reference = _by_section(evidence.reference if evidence else (), salt)
    sections = tuple(_section(one, evidence, legs, reference, within_s) for one in groups)
    journeys = []
    for leg in evidence.legs if evidence else ():
        if selection.holds(leg.ends.departure_s):
            trace = replace(trace_of(leg), run_id=_named(leg.run_id, salt))
            journeys.append((trace, leg.start.axis_m, leg.direction == "up"))
    return RunReport(
        sections,
        selection,
        len({row.run_id for row in named}),
        len(named),
        sum(len(one.rows) for one in groups),
        salt is not None,
        evidence.reception if evidence else (),
        tuple(journeys),
        tuple((one.name, one.axis_m) for one in evidence.way.stations) if evidence else (),
        tuple(notes),
    )


def _named(run_id: str, salt: bytes | None) -> str:
    return run_id if salt is None else pseudonym(run_id, salt)


Sections = Mapping[tuple[str, str], Sequence[LegRun]]


def _by_section(legs: Sequence[LegRun], salt: bytes | None) -> Sections:
    found: dict[tuple[str, str], list[LegRun]] = {}
    for leg in legs:
        named = replace(leg, run_id=_named(leg.run_id, salt))
        found.setdefault((leg.start.name, leg.end.name), []).append(named)
    return found


def _section(
    group: Group, evidence: Evidence | None, legs: Sections, reference: Sections, within_s: float
) -> SectionReport:
    margin = saving_margin(group, within_s)
    patterns = patterns_of(group.rows, reference_time(group)[0]) if group.rows else ()
    mine = [leg for row in group.rows if (leg := _leg_of(row, legs)) is not None]
    if evidence is None or not mine:
        return SectionReport(group, margin, patterns, None)
    pairs = [
        (trace_of(leg), trace_of(other))
        for leg in mine
        for other in reference.get((leg.start.name, leg.end.name), ())
        if other.run_id == leg.run_id and abs(other.ends.departure_s - leg.ends.departure_s) < leg.running_time_s / 2.0
    ]
    return SectionReport(group, margin, patterns, _driving(mine, margin, evidence, pairs))


def _leg_of(row: RunRow, legs: Sections) -> LegRun | None:
    for leg in legs.get((row.start, row.end), ()):
        if leg.run_id == row.run_id and abs(leg.ends.departure_s - row.departure_s) < SAME_LEG_S:
            return leg
    return None


def _driving(
    legs: Sequence[LegRun],
    margin: SavingMargin | None,
    evidence: Evidence,
    pairs: Sequence[tuple[SpeedTrace, SpeedTrace]],
) -> Driving:
    start, end = legs[0].start, legs[0].end
    way = _way(evidence.way, start, end)
    traces = tuple(trace_of(leg) for leg in legs)
    speeds = population(traces, way.grid_m)
    best = None
    if margin is not None:
        same = [k for k, one in enumerate(traces) if same_leg(one, margin.best)]
        best = same[0] if same else None
    found, why = None, ""
    observed = not np.isfinite(way.limit_mps).any()
    if margin is not None:
        try:
            section = section_between(evidence.way, evidence.vehicle, start.axis_m, end.axis_m)
            if observed:
                section = replace(section, limit_mps=_observed_limit(section, speeds, way.grid_m))
            found = optimum(section, evidence.vehicle, margin.best.running_time_s)
        except OptimumError as error:
            why = str(error)
    return Driving(
        traces,
        speeds,
        way,
        tuple(hills_of(speeds, way.grid_m)),
        tuple(reaccelerations(speeds, way.grid_m)),
        None if best is None else difference_of(speeds, way.grid_m, best, way.limit_mps),
        best,
        found,
        why,
        observed,
        tuple(departures(pairs, float(way.grid_m[-1]))),
    )


def _observed_limit(section: Section, speeds_mps: Floats, grid_m: Floats) -> Floats:
    """Limit of a section: the highest observed speed within 100 m.

    Beside stations speeds are low because trains stop there: the first and last 300 m take the highest of all.
    """
    highest = speeds_mps.max(axis=0)
    padded = np.pad(highest, OBSERVED_CELLS, mode="edge")
    widest = np.lib.stride_tricks.sliding_window_view(padded, 2 * OBSERVED_CELLS + 1).max(axis=1)
    widest[(grid_m < BESIDE_M) | (grid_m > grid_m[-1] - BESIDE_M)] = highest.max()
    along = np.abs(section.axis_m - section.axis_m[0])
    return np.asarray(np.minimum(section.limit_mps, np.interp(along, grid_m, widest)))


def same_leg(trace: SpeedTrace, row: RunRow) -> bool:
    """Whether a trace and a row are of one leg (of one section)."""
    return trace.run_id == row.run_id and abs(trace.departure_s - row.departure_s) < SAME_LEG_S


def _way(line: Alignment, start: Station, end: Station) -> Way:
    length = abs(end.axis_m - start.axis_m)
    sign = 1.0 if end.axis_m > start.axis_m else -1.0
    grid = grid_over(length)
    axis = start.axis_m + sign * grid
    between = sorted(
        (sign * (one.axis_m - start.axis_m), one.name)
        for one in line.stations
        if -1.0 <= sign * (one.axis_m - start.axis_m) <= length + 1.0
    )
    return Way(
        grid,
        line.speed_limit_mps(axis),
        sign * line.gradient_permille(axis),
        tuple((name, place) for place, name in between),
    )
