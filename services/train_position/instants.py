"""One instant of the train's run, and what physics allows after it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

Sense = Literal[-1, 0, 1]
"""+1: the vehicle's forward axis points towards rising `axis_m`; 0: not known."""


class Instant(NamedTuple):
    """The sums at one instant; interpolated ones are floats all the same."""

    t_ns: int
    distance_m: float
    way_m: float
    greatest_m: float
    least_m: float
    likeliest_m: float
    rolled_m: float
    """Of the likeliest displacement, what the wheels have measured (shifts of the front end left out)."""
    variance_m2: float
    excess_m: float
    provisional_m: float
    speed_mps: float
    """Along the vehicle's forward axis."""
    speed_bound_mps: float


class Scale(NamedTuple):
    """Relative error of distance by the wheel: true way = measured way × (1 + ε), ε between these."""

    least: float
    greatest: float

    @property
    def largest(self) -> float:
        """Largest error of either sign."""
        return max(abs(self.least), abs(self.greatest))


@dataclass(frozen=True, slots=True)
class Physics:
    """What no train of the line exceeds."""

    speed_mps: float
    acceleration_mps2: float


def tube(sure: Instant, t_ns: int, physics: Physics, sense: Sense) -> tuple[float, float]:
    """Least and greatest displacement that physics allows after an instant: v T ± (δv T + a T² / 2)."""
    dt_s = (t_ns - sure.t_ns) / 1e9
    mean_m, limit_m = sure.speed_mps * dt_s, physics.speed_mps * dt_s
    doubt_m = sure.speed_bound_mps * dt_s + physics.acceleration_mps2 * dt_s**2 / 2.0
    if sense == 0:
        span_m = min(abs(mean_m) + doubt_m, limit_m)
        return -span_m, span_m
    return max(sense * mean_m - doubt_m, -limit_m), min(sense * mean_m + doubt_m, limit_m)
