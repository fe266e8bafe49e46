"""The likeliest place of the front end: a Kalman filter over its place and the wheel's scale.

State x = (p, ε): place now and relative error of the wheel. The odometry moves it by
`p += m (1 + ε)`; a measurement z of the place at an earlier instant, m₀ metres of rolling ago, is

    z = p - m₀ (1 + ε) - shifts + noise,   H = (1, -m₀)

with what the odometry has added to the variance since then counted as noise of the measurement. The
estimate lives inside the interval that is certain and never moves that.
"""

from __future__ import annotations

from typing import Final

from services.train_position.instants import Instant

SCALE_WALK: Final = 1e-10
"""Variance per metre of the scale: 0.1 % per 10 km, as tyres warm and creep changes."""


class Estimate:
    """Place and scale with their covariance (Joseph form)."""

    def __init__(self, axis_m: float, sigma_m: float, scale: float, scale_sigma: float) -> None:
        """Begin at a place."""
        self.axis_m = axis_m
        self.scale = scale
        self.var_m2 = sigma_m**2
        self.cov_m = 0.0
        self.scale_var = scale_sigma**2

    def move(self, before: Instant, now: Instant) -> None:
        """Go on from one instant to the next."""
        rolled_m = now.rolled_m - before.rolled_m
        shift_m = now.likeliest_m - before.likeliest_m - rolled_m
        self.axis_m += rolled_m * (1.0 + self.scale) + shift_m
        self.var_m2 += 2.0 * rolled_m * self.cov_m + rolled_m**2 * self.scale_var
        self.var_m2 += now.variance_m2 - before.variance_m2
        self.cov_m += rolled_m * self.scale_var
        self.scale_var += SCALE_WALK * abs(rolled_m)

    def back(self, then: Instant, now: Instant) -> float:
        """Place at an earlier instant."""
        rolled_m = now.rolled_m - then.rolled_m
        return self.axis_m - (now.likeliest_m - then.likeliest_m) - rolled_m * self.scale

    def measure(self, axis_m: float, sigma_m: float, then: Instant, now: Instant) -> None:
        """Take a measurement of the place at an earlier instant."""
        rolled_m = now.rolled_m - then.rolled_m
        noise_m2 = sigma_m**2 + max(now.variance_m2 - then.variance_m2, 0.0) + (then.provisional_m / 3.0) ** 2
        innovation_m = axis_m - self.back(then, now)
        to_place = self.var_m2 - rolled_m * self.cov_m
        to_scale = self.cov_m - rolled_m * self.scale_var
        total_m2 = to_place - rolled_m * to_scale + noise_m2
        gain_place, gain_scale = to_place / total_m2, to_scale / total_m2
        self.axis_m += gain_place * innovation_m
        self.scale += gain_scale * innovation_m
        # Joseph: (I - K H) P (I - K H)' + K R K'
        a, b, c = self.var_m2, self.cov_m, self.scale_var
        k, e = gain_place, gain_scale
        f00, f01, f10, f11 = 1.0 - k, k * rolled_m, -e, 1.0 + e * rolled_m
        self.var_m2 = f00 * (f00 * a + f01 * b) + f01 * (f00 * b + f01 * c) + k * k * noise_m2
        self.cov_m = f10 * (f00 * a + f01 * b) + f11 * (f00 * b + f01 * c) + k * e * noise_m2
        self.scale_var = f10 * (f10 * a + f11 * b) + f11 * (f10 * b + f11 * c) + e * e * noise_m2

    def confine(self, least_m: float, greatest_m: float, least_scale: float, greatest_scale: float) -> None:
        """Keep place and scale where they are certain to be."""
        self.axis_m = min(max(self.axis_m, least_m), greatest_m)
        self.scale = min(max(self.scale, least_scale), greatest_scale)
