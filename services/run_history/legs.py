"""Cutting a run into legs from one station's stop to the next, and completing departures and arrivals.

Times follow Maki et al., section 3.2: from the middle of the leg outwards to where the speed falls below V_stop
(t2, t4), then a ramp back to departure (t1) and on to arrival (t5): assumed, or the train's own (`leg_ends`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.line import Station
from services.run_history.leg_ends import HALT, START, V_STOP_MPS, Ends, Onset, Ramp, crossing_s, onset_of
from services.run_history.middle import median_of
from services.run_history.ramp_places import earlier_s

Floats = NDArray[np.float64]
STATION_REACH_M: Final = 250.0
"""So near to its place a train stops at a station: platforms are long, fixes under roofs are off."""
SHORTEST_STOP_S: Final = 4.0
ASIDE_S: Final = 60.0
"""So far into a stop and into a leg its ends are looked for."""
START_SIGMA_S: Final = 1.0
HALT_SIGMA_S: Final = 1.5
"""How far ramps from speeds alone are off; trains creep to their halt in more ways than they start."""


@dataclass(frozen=True, slots=True)
class Stop:
    """A train below V_stop."""

    first: int
    """Number of the first fix below V_stop …"""
    last: int
    """… and of the last."""
    way_m: float
    """Median place meanwhile."""
    station: Station | None


@dataclass(frozen=True, slots=True)
class Leg:
    """A leg in numbers of fixes: those at or above V_stop at its ends."""

    start: Stop
    end: Stop
    first: int
    last: int


def stops_of(t_s: Floats, way_m: Floats, speed_mps: Floats, stations: Sequence[Station]) -> list[Stop]:
    """Where a train was below V_stop, in order; speeds without sign. Shapes (n,)."""
    slow = np.concatenate(([False], speed_mps < V_STOP_MPS, [False]))
    edges = np.flatnonzero(slow[1:] != slow[:-1])
    found = []
    for first, past in zip(edges[::2], edges[1::2], strict=True):
        last = int(past) - 1
        long_enough = t_s[last] - t_s[first] >= SHORTEST_STOP_S or first == 0 or past == len(t_s)
        if long_enough:
            place = median_of(way_m[first:past])
            found.append(Stop(int(first), last, place, _station_at(place, stations)))
    return found


def _station_at(way_m: float, stations: Sequence[Station]) -> Station | None:
    near = min(stations, key=lambda one: abs(one.axis_m - way_m), default=None)
    if near is None or abs(near.axis_m - way_m) > max(STATION_REACH_M, near.platform_m):
        return None
    return near


def legs_of(stops: Sequence[Stop]) -> list[Leg]:
    """Legs between stops at two different stations that follow each other; stops elsewhere lie within a leg."""
    found = []
    before: Stop | None = None
    for stop in stops:
        if stop.station is None:
            continue
        if before is not None and before.station is not None and before.station.id != stop.station.id:
            found.append(Leg(before, stop, before.last + 1, stop.first - 1))
        before = stop
    return [leg for leg in found if leg.last > leg.first]


def assumed_ends(leg: Leg, t_s: Floats, speed_mps: Floats, acceleration_mps2: float, deceleration_mps2: float) -> Ends:
    """Departure and arrival of a leg by assumed ramps below V_stop (Maki et al., 3.2); speeds without sign."""
    rising_s = crossing_s(t_s, speed_mps, leg.first - 1, leg.first)
    falling_s = crossing_s(t_s, speed_mps, leg.last, leg.last + 1)
    departure_s = rising_s - V_STOP_MPS / acceleration_mps2
    arrival_s = falling_s + V_STOP_MPS / deceleration_mps2
    return Ends(departure_s, rising_s, falling_s, arrival_s)


def start_of(leg: Leg, t_s: Floats, speed_mps: Floats, place_m: Floats, *, derived: bool = False) -> Onset | None:
    """The start of a leg from speeds without sign and places that rise; its `first` counts all fixes.

    `derived`: the speeds come from smoothed places. Smoothing has rounded the corner to standstill already, and the
    fixed time of the ramp is in it.
    """
    begin = max(leg.start.first, int(np.searchsorted(t_s, t_s[leg.start.last] - ASIDE_S)))
    past = min(leg.last + 1, int(np.searchsorted(t_s, t_s[leg.first] + ASIDE_S)))
    near, stop_fixes = slice(begin, past), leg.start.last + 1 - begin
    onset = _onset(t_s[near], speed_mps[near], place_m[near], stop_fixes, _ramp(START, derived), START_SIGMA_S)
    return None if onset is None else Onset(onset.still_s, onset.stop_speed_s, begin + onset.first, onset.slope_mps2)


def halt_of(leg: Leg, t_s: Floats, speed_mps: Floats, place_m: Floats, *, derived: bool = False) -> Onset | None:
    """The arrival of a leg: a start with its time reversed, turned back; slope positive."""
    begin = max(leg.first, int(np.searchsorted(t_s, t_s[leg.last] - ASIDE_S)))
    past = min(leg.end.last + 1, int(np.searchsorted(t_s, t_s[leg.end.first] + ASIDE_S)))
    back = (-t_s[begin:past][::-1], speed_mps[begin:past][::-1], -place_m[begin:past][::-1])
    onset = _onset(*back, past - leg.end.first, _ramp(HALT, derived), HALT_SIGMA_S)
    if onset is None:
        return None
    return Onset(-onset.still_s, -onset.stop_speed_s, past - 1 - onset.first, onset.slope_mps2)


def _ramp(ramp: Ramp, derived: bool) -> Ramp:  # noqa: FBT001 - handed on
    return replace(ramp, fixed_s=0.0) if derived else ramp


def _onset(
    t_s: Floats, speed_mps: Floats, place_m: Floats, stop_fixes: int, ramp: Ramp, sigma_s: float
) -> Onset | None:
    """A start by its speeds, moved by what places say; the arrays begin in the stop, with so many of its fixes."""
    onset = onset_of(t_s, speed_mps, ramp)
    if onset is None:
        return None
    early_s = earlier_s(t_s, place_m, speed_mps, onset.first, stop_fixes, onset.slope_mps2, sigma_s)
    return Onset(onset.still_s - early_s, onset.stop_speed_s, onset.first, onset.slope_mps2)


def ends_by_slope(assumed: Ends, start: Onset | None, halt: Onset | None) -> Ends:
    """Ends by the train's own slopes, by assumed ones where there is no slope."""
    departure_s, rising_s = assumed.departure_s, assumed.rising_s
    falling_s, arrival_s = assumed.falling_s, assumed.arrival_s
    if start is not None:
        departure_s, rising_s = start.still_s, start.stop_speed_s
    if halt is not None:
        falling_s, arrival_s = halt.stop_speed_s, halt.still_s
    return Ends(departure_s, rising_s, falling_s, arrival_s)
