"""What the speeds of a section's runs tell: hills, braking and accelerating again, the best run and its optimum.

Of thousands of runs only those stay in memory that are drawn: the first two hundred and those that are asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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
from services.run_history.observed_limits import SameLimits, same_limits
from services.run_history.optimum import Optimum, OptimumError, optimum
from services.run_history.reference_departure import Departure
from services.run_history.run_rows import RunRow
from services.run_history.speed_trace import SpeedTrace, grid_over, population
from services.run_history.vehicle import Vehicle

Floats = NDArray[np.float64]
SAME_LEG_S: Final = 5.0
"""Departures of one leg, once from the table and once from the log, differ by rounding alone; by less than a leg."""
CHEAPEST: Final = "the energy-saving run is itself the cheapest within its limits"
MOST_DRAWN: Final = 200
"""Runs drawn in grey; more make a file heavy and the picture no clearer."""


@dataclass(frozen=True, slots=True)
class Way:
    """The section under a group's runs. Arrays have shape (n,)."""

    start_axis_m: float
    sign: float
    """Of the direction of running along the axis."""
    grid_m: Floats
    limit_mps: Floats
    """inf where none is known."""
    gradient_permille: Floats
    """Positive uphill in the direction of running."""
    stations: tuple[tuple[str, float], ...]
    """Name and way from the departure station."""


@dataclass(frozen=True, slots=True)
class Driving:
    """What the speeds of a group's runs tell."""

    traces: tuple[SpeedTrace, ...]
    """Those that are drawn."""
    again: tuple[tuple[Reacceleration, ...], ...]
    """Of each trace."""
    way: Way
    hills: tuple[Hill, ...]
    """Of all runs."""
    difference: Difference | None
    """Of the representative run; None where there is none, or no trace of it."""
    best: int | None
    """Number of its trace."""
    optimum: Optimum | None
    """In the running time and under the limits of the representative run."""
    no_optimum: str
    """Why there is none."""
    limits: SameLimits | None
    departures: tuple[Departure, ...]
    """Where logs leave their reference."""


def driving_of(
    traces: Sequence[SpeedTrace],
    way: Way,
    line: Alignment,
    vehicle: Vehicle,
    best: RunRow | None,
    wanted: Sequence[RunRow],
    left: Sequence[Departure],
) -> Driving:
    """Driving of all runs of a section; kept are the traces of `best`, of the `wanted` rows, and the first 200."""
    speeds = population(traces, way.grid_m)
    again = reaccelerations(speeds, way.grid_m)
    own = next((k for k, one in enumerate(traces) if best is not None and same_leg(one, best)), None)
    kept = [
        k for k, one in enumerate(traces) if k < MOST_DRAWN or k == own or any(same_leg(one, row) for row in wanted)
    ]
    limits, found, why = None, None, ""
    if own is not None and best is not None:
        try:
            limits = same_limits(line, vehicle, traces, own, way.start_axis_m, way.sign)
            found = optimum(limits.section, limits.vehicle, best.running_time_s)
            if found.traction_kwh > best.energy_kwh:
                found, why = None, CHEAPEST
        except OptimumError as error:
            why = str(error)
    return Driving(
        tuple(traces[k] for k in kept),
        tuple(again[k] for k in kept),
        way,
        tuple(hills_of(speeds, way.grid_m)),
        None if own is None else difference_of(speeds, way.grid_m, own, way.limit_mps, again),
        None if own is None else kept.index(own),
        found,
        why,
        limits,
        tuple(left),
    )


def same_leg(trace: SpeedTrace, row: RunRow) -> bool:
    """Whether a trace and a row are of one leg (of one section)."""
    return trace.run_id == row.run_id and abs(trace.departure_s - row.departure_s) < SAME_LEG_S


def way_between(line: Alignment, start: Station, end: Station) -> Way:
    """Grid, limits, gradients and stations from one station to another."""
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
        start.axis_m,
        sign,
        grid,
        line.speed_limit_mps(axis),
        sign * line.gradient_permille(axis),
        tuple((name, place) for place, name in between),
    )
