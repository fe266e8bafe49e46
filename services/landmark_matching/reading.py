"""What the odometry says step by step, and the sample of curvature that matching makes of it.

Curvature and distance are averaged over the same window, so they lag alike: a sample tells the
curvature about a place that the train has left behind, with the time at which it was there.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

KEPT_S: Final = 6.0
"""History that is kept to find when the train was at the middle of the window."""

LEAP_S: Final = 0.5


class Reading(NamedTuple):
    """One step of the odometry, in the sense of running of the leading end."""

    t_s: float
    distance_m: float
    speed_mps: float
    curvature_per_m: float
    """Mean over the window; NaN when unknown."""
    curvature_distance_m: float
    """Distance averaged alike; NaN when unknown."""
    slip: bool
    healthy: bool
    """False where the odometry has lost its sensors."""
    excess_m: float = 0.0
    """What slips and gaps may have added to the distance's error so far."""
    sigma_per_m: float = float("nan")
    """Noise of the curvature, one standard deviation; NaN when unknown."""


class Sample(NamedTuple):
    """Curvature about one place."""

    t_s: float
    """When the train was at `distance_m`."""
    distance_m: float
    curvature_per_m: float
    """NaN where it is not to be used; `fault` says why."""
    speed_mps: float
    """Mean over the window."""
    window_m: float
    """Way gone during the window."""
    fault: str
    """Empty when well; else `slip`, `low speed`, `reverse running`, `gap`, `leap`, `no curvature`."""
    excess_m: float
    sigma_per_m: float


class SampleMaker:
    """Turns readings into samples; remembers the last seconds."""

    def __init__(self, window_s: float, lowest_speed_mps: float, longest_step_s: float, leap_mps2: float) -> None:
        """Start without history. A speed that changes faster than `leap_mps2` is a wheel's that slips unseen."""
        self._window_s = window_s
        self._lowest_mps = lowest_speed_mps
        self._longest_s = longest_step_s
        self._leap_mps2 = leap_mps2
        self._leap_until_s = -math.inf
        self._past: deque[Reading] = deque()
        self._gap_until_s = -math.inf
        self._slip_until_s = -math.inf

    def take(self, reading: Reading) -> Sample | None:
        """Sample of this step; None for a reading that repeats, goes back in time, or has no finite distance."""
        past = self._past
        if not (math.isfinite(reading.t_s) and math.isfinite(reading.distance_m) and math.isfinite(reading.speed_mps)):
            return None
        if past and reading.t_s <= past[-1].t_s:
            return None
        if not past or reading.t_s - past[-1].t_s > self._longest_s:
            self._gap_until_s = reading.t_s + self._window_s
            past.clear()
        if reading.slip:
            self._slip_until_s = reading.t_s + self._window_s
        if self._leaps(reading):
            self._leap_until_s = reading.t_s + self._window_s
        past.append(reading)
        while past[0].t_s < reading.t_s - KEPT_S:
            past.popleft()
        return self._sample(reading)

    def _leaps(self, now: Reading) -> bool:
        """Whether the speed has changed faster than a train's, over any time up to half a second."""
        for one in reversed(self._past):
            dt_s = now.t_s - one.t_s
            if dt_s > LEAP_S + 1e-9:
                return False
            if abs(now.speed_mps - one.speed_mps) > self._leap_mps2 * dt_s:
                return True
        return False

    def _sample(self, now: Reading) -> Sample:
        begin_m = self._distance_at(now.t_s - self._window_s)
        window_m = now.distance_m - begin_m
        speed_mps = window_m / self._window_s
        usable = math.isfinite(now.curvature_per_m) and math.isfinite(now.curvature_distance_m)
        place_m = now.curvature_distance_m if usable else 0.5 * (begin_m + now.distance_m)
        fault = self._fault(now, speed_mps, usable=usable)
        return Sample(
            self._time_at(place_m),
            place_m,
            now.curvature_per_m if not fault else float("nan"),
            speed_mps,
            window_m,
            fault,
            now.excess_m,
            now.sigma_per_m,
        )

    def _fault(self, now: Reading, speed_mps: float, *, usable: bool) -> str:
        slowest = now.speed_mps
        for one in reversed(self._past):
            if one.t_s < now.t_s - self._window_s:
                break
            slowest = min(slowest, one.speed_mps)
        if now.t_s <= self._slip_until_s:
            return "slip"
        if now.t_s < self._gap_until_s or not now.healthy:
            return "gap"
        if slowest < -self._lowest_mps / 10.0 or speed_mps < 0.0:
            return "reverse running"
        if slowest < self._lowest_mps:
            return "low speed"
        if now.t_s <= self._leap_until_s:
            return "leap"
        return "" if usable else "no curvature"

    def _distance_at(self, t_s: float) -> float:
        past = self._past
        newer = past[-1]
        for older in reversed(past):
            if older.t_s <= t_s:
                if newer.t_s == older.t_s:
                    return older.distance_m
                share = (t_s - older.t_s) / (newer.t_s - older.t_s)
                return older.distance_m + share * (newer.distance_m - older.distance_m)
            newer = older
        return past[0].distance_m

    def _time_at(self, distance_m: float) -> float:
        """When the train was at a distance not long ago."""
        past = self._past
        newer = past[-1]
        for older in reversed(past):
            if older.distance_m <= distance_m:
                way_m = newer.distance_m - older.distance_m
                return (
                    newer.t_s
                    if way_m <= 0.0
                    else older.t_s + (newer.t_s - older.t_s) * min(1.0, (distance_m - older.distance_m) / way_m)
                )
            newer = older
        return past[0].t_s
