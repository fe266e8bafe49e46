"""A train that shuttles between stations: where it is and how fast, as a function of time alone.

Each leg is a trapezium of speed: constant acceleration, cruise, constant braking (a triangle when
the stations are too close). At the last station the train turns back; the cycle repeats for ever.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt


class TrainRunError(ValueError):
    """Stations or rates that make no run."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion of a point of the train along the axis."""

    axis_m: float
    speed_mps: float
    """Towards rising `axis_m`; negative on the way back."""
    acceleration_mps2: float


@dataclass(frozen=True, slots=True)
class _Phase:
    start_s: float
    axis_m: float
    speed_mps: float
    acceleration_mps2: float


class TrainRun:
    """The endless run of one train."""

    def __init__(
        self,
        stations_m: tuple[float, ...],
        *,
        cruise_mps: float,
        acceleration_mps2: float,
        braking_mps2: float,
        dwell_s: float,
    ) -> None:
        """Start in the first station, at the beginning of its dwell.

        Raises TrainRunError unless there are two stations in rising order and positive rates.
        """
        if len(stations_m) < 2 or any(b <= a for a, b in pairwise(stations_m)):  # noqa: PLR2004 - a run has two ends
            msg = f"a run needs at least two stations in rising order, not {stations_m}"
            raise TrainRunError(msg)
        if min(cruise_mps, acceleration_mps2, braking_mps2) <= 0 or dwell_s < 0:
            msg = "speed and accelerations must be positive and the dwell not negative"
            raise TrainRunError(msg)
        calls = (*stations_m, *stations_m[-2::-1])
        self._phases: list[_Phase] = []
        time_s = 0.0
        for here, there in pairwise(calls):
            self._phases.append(_Phase(time_s, here, 0.0, 0.0))
            time_s += dwell_s
            time_s = self._add_leg(time_s, here, there, cruise_mps, acceleration_mps2, braking_mps2)
        self.period_s = time_s
        """Duration of one cycle there and back."""
        self._starts = [phase.start_s for phase in self._phases]

    def _add_leg(
        self, time_s: float, here: float, there: float, cruise: float, acceleration: float, braking: float
    ) -> float:
        sign = 1.0 if there > here else -1.0
        distance = abs(there - here)
        top = min(cruise, sqrt(2 * distance * acceleration * braking / (acceleration + braking)))
        ramp_m, stop_m = top**2 / (2 * acceleration), top**2 / (2 * braking)
        cruise_s = max(distance - ramp_m - stop_m, 0.0) / top
        cruise_from_s = time_s + top / acceleration
        brake_from_s = cruise_from_s + cruise_s
        self._phases += [
            _Phase(time_s, here, 0.0, sign * acceleration),
            _Phase(cruise_from_s, here + sign * ramp_m, sign * top, 0.0),
            _Phase(brake_from_s, there - sign * stop_m, sign * top, -sign * braking),
        ]
        return brake_from_s + top / braking

    def at(self, time_s: float) -> Motion:
        """Motion at a time since the start (any time, also before it)."""
        within_s = time_s % self.period_s
        phase = self._phases[bisect_right(self._starts, within_s) - 1]
        t = within_s - phase.start_s
        speed = phase.speed_mps + phase.acceleration_mps2 * t
        axis = phase.axis_m + phase.speed_mps * t + phase.acceleration_mps2 * t * t / 2
        return Motion(axis, speed, phase.acceleration_mps2)
