"""Speed of a leg over the way from its departure station, and populations of such on one grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.run_history.run_analysis import LegRun

Floats = NDArray[np.float64]
GRID_M: Final = 10.0
KMH: Final = 3.6


@dataclass(frozen=True, slots=True)
class SpeedTrace:
    """One leg. Arrays have shape (n,)."""

    run_id: str
    departure_s: float
    """Unix time."""
    way_m: Floats
    """From the departure station's place, never falling; trains stop some metres before or behind it."""
    time_s: Floats
    """Since departure."""
    speed_mps: Floats


def trace_of(leg: LegRun) -> SpeedTrace:
    """Trace of an analysed leg, with its completed departure and arrival as ends."""
    sign = 1.0 if leg.end.axis_m > leg.start.axis_m else -1.0
    inside = (leg.t_s > leg.ends.departure_s) & (leg.t_s < leg.ends.arrival_s)
    way = sign * (leg.way_m - leg.start.axis_m)
    first, last = np.interp((leg.ends.departure_s, leg.ends.arrival_s), leg.t_s, way)
    time = leg.t_s[inside] - leg.ends.departure_s
    return SpeedTrace(
        leg.run_id,
        leg.ends.departure_s,
        np.maximum.accumulate(np.concatenate(([first], way[inside], [last]))),
        np.concatenate(([0.0], time, [leg.running_time_s])),
        np.concatenate(([0.0], leg.speed_mps[inside], [0.0])),
    )


def grid_over(length_m: float) -> Floats:
    """Places every 10 m from 0 to the length."""
    return np.arange(0.0, length_m + GRID_M / 2.0, GRID_M)


def speeds_on(trace: SpeedTrace, grid_m: Floats) -> Floats:
    """Speed [m/s] at each place of the grid; where a train stood, the last speed said there; 0 beyond its stops."""
    keep = np.concatenate((np.diff(trace.way_m) > 0.0, [True]))
    return np.asarray(np.interp(grid_m, trace.way_m[keep], trace.speed_mps[keep]))


def population(traces: Sequence[SpeedTrace], grid_m: Floats) -> Floats:
    """Speeds of all, shape (runs, places)."""
    if not traces:
        return np.zeros((0, len(grid_m)))
    return np.stack([speeds_on(one, grid_m) for one in traces])
