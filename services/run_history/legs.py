"""Cutting a run into legs from one station's stop to the next, and completing departures and arrivals.

Times follow Maki et al., section 3.2: from the middle of the leg outwards to where the speed falls below V_stop
(t2, t4), then a ramp of assumed acceleration back to departure (t1), of assumed deceleration on to arrival (t5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.line import Station

Floats = NDArray[np.float64]
V_STOP_MPS: Final = 8.0 / 3.6
STATION_REACH_M: Final = 250.0
"""So near to its place a train stops at a station: platforms are long, fixes under roofs are off."""
SHORTEST_STOP_S: Final = 4.0


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


@dataclass(frozen=True, slots=True)
class Ends:
    """Departure and arrival [s], by the same clock as the fixes."""

    departure_s: float
    """t1."""
    rising_s: float
    """t2: the speed rises through V_stop."""
    falling_s: float
    """t4: it falls through it."""
    arrival_s: float
    """t5."""


def stops_of(t_s: Floats, way_m: Floats, speed_mps: Floats, stations: Sequence[Station]) -> list[Stop]:
    """Where a train was below V_stop, in order; speeds without sign. Shapes (n,)."""
    slow = np.concatenate(([False], speed_mps < V_STOP_MPS, [False]))
    edges = np.flatnonzero(slow[1:] != slow[:-1])
    found = []
    for first, past in zip(edges[::2], edges[1::2], strict=True):
        last = int(past) - 1
        long_enough = t_s[last] - t_s[first] >= SHORTEST_STOP_S or first == 0 or past == len(t_s)
        if long_enough:
            place = float(np.median(way_m[first:past]))
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


def ends_of(leg: Leg, t_s: Floats, speed_mps: Floats, acceleration_mps2: float, deceleration_mps2: float) -> Ends:
    """Departure and arrival of a leg; speeds without sign."""
    rising_s = _crossing(t_s, speed_mps, leg.first - 1, leg.first)
    falling_s = _crossing(t_s, speed_mps, leg.last, leg.last + 1)
    departure_s = rising_s - V_STOP_MPS / acceleration_mps2
    arrival_s = falling_s + V_STOP_MPS / deceleration_mps2
    return Ends(departure_s, rising_s, falling_s, arrival_s)


def _crossing(t_s: Floats, speed_mps: Floats, before: int, after: int) -> float:
    """When the speed passes V_stop between two neighbouring fixes."""
    low, high = speed_mps[before], speed_mps[after]
    share = 0.5 if high == low else (V_STOP_MPS - low) / (high - low)
    return float(t_s[before] + np.clip(share, 0.0, 1.0) * (t_s[after] - t_s[before]))
