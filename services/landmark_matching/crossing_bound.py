"""How wrong the place of a crossing may be.

A curvature wrong by dk moves the crossing by dk / slope, where the slope is that of the averaged
curvature at the crossing. What may be wrong with the curvature and with the distance:

* noise of the yaw rate, as the passage's own scatter shows it: `lowest_confidence` standard deviations of it, and of
  the bias taken from two straights;
* the gyro's bias within the curve: half the difference between the two straights, over the speed (where only one of
  them tells it, `gyro_drift_radps`; where none does, `gyro_bias_radps`);
* the scale of wheel and gyro: the mean curvature tells it to its own noise, the rest moves the crossing by
  level / slope per unit;
* the delay between inertial sensor and wheel: `sensor_skew_s` times the speed;
* transitions that are no clothoids;
* a length that differs from the expected one: whichever end the difference lies at, it is at most that much.
"""

from __future__ import annotations

import math

from services.landmark_matching.passage import Measured, Passage, Straight
from services.landmark_matching.settings import MatchSettings

SCALE_NOISE_SHARE = 0.01
"""Error of the measured scale that is not noise of single samples: curvature of the arc within its own tolerance."""
LEAST_SHARE = 0.4
"""Noise is taken from the passage's own scatter about the database's curve, but not below this share of the stated."""


def crossing_bound_m(
    passage: Passage, measured: Measured, straights: tuple[Straight, Straight], settings: MatchSettings
) -> float:
    """Error of the exit crossing that is vouched for, one side; without the landmark's own accuracy."""
    speed_mps = passage.exit_speed_mps
    slope = max(measured.exit.slope_per_m2, 1e-9)
    stated = settings.noise_per_s / speed_mps if math.isnan(passage.sigma_per_m) else passage.sigma_per_m
    seen = measured.shape_error * measured.scale * abs(passage.shape.curvature_per_m)
    sigma = max(LEAST_SHARE * stated, seen)
    noise_m = settings.lowest_confidence * sigma * math.sqrt(1.5) / slope
    known = [one.yaw_rate_radps for one in straights if one.yaw_rate_radps is not None]
    left_radps = 0.5 * abs(known[0] - known[1]) if len(known) == len(straights) else settings.gyro_drift_radps
    bias_m = (left_radps if known else settings.gyro_bias_radps) / speed_mps / slope
    level = passage.landmark.lower_share * abs(passage.shape.curvature_per_m)
    scale_m = SCALE_NOISE_SHARE * level / slope
    skew_m = settings.sensor_skew_s * speed_mps
    return noise_m + bias_m + scale_m + skew_m + settings.transition_model_m + abs(measured.length_error_m)
