"""Going on without satellites: distance and speed since the last measurement, and how uncertain they grow."""

from __future__ import annotations

import math
from typing import Final

WHEEL_SIGMA_MPS: Final = 0.1
FASTEST_MPS: Final = 100.0
"""No train is faster; nobody gets further away than at this speed."""


class Coasting:
    """Distance run since the last measurement: a Kalman filter of distance and speed."""

    def __init__(self, speed_mps: float, variance_m2ps2: float) -> None:
        """Start at the speed known last."""
        self.distance_m = 0.0
        self.speed_mps = speed_mps
        self.time_s = 0.0
        self._distance_m2 = 0.0
        self._both = 0.0
        self.speed_m2ps2 = variance_m2ps2
        self._wheel_m = 0.0
        self._scale_sigma = 0.0

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the distance; the scale of the wheels errs in one direction all the way."""
        walked = math.sqrt(self._distance_m2 + (self._scale_sigma * self._wheel_m) ** 2)
        return min(walked, FASTEST_MPS * self.time_s)

    def go(self, dt_s: float, acceleration_mps2: float) -> None:
        """Let time pass at the present speed, which walks by `acceleration_mps2` in a second."""
        walk = acceleration_mps2**2
        self.time_s += dt_s
        self.distance_m += self.speed_mps * dt_s
        self._distance_m2 += 2.0 * self._both * dt_s + self.speed_m2ps2 * dt_s**2 + walk * dt_s**3 / 3.0
        self._both += self.speed_m2ps2 * dt_s + walk * dt_s**2 / 2.0
        self.speed_m2ps2 += walk * dt_s

    def roll(self, wheel_mps: float, scale_sigma: float, dt_s: float) -> None:
        """Take in the speed by the wheels, already scaled, without a sign."""
        measured_mps = math.copysign(wheel_mps, self.speed_mps)
        spread = self.speed_m2ps2 + WHEEL_SIGMA_MPS**2
        gain_distance, gain_speed = self._both / spread, self.speed_m2ps2 / spread
        surprise_mps = measured_mps - self.speed_mps
        self.distance_m += gain_distance * surprise_mps
        self.speed_mps += gain_speed * surprise_mps
        self._distance_m2 -= gain_distance * self._both
        self._both *= 1.0 - gain_speed
        self.speed_m2ps2 *= 1.0 - gain_speed
        self._wheel_m += wheel_mps * dt_s
        self._scale_sigma = max(self._scale_sigma, scale_sigma)
