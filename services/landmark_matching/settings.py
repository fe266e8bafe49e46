"""Settings of the matching, with where each figure comes from."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

Positive = Annotated[float, Meta(gt=0.0)]
Share = Annotated[float, Meta(gt=0.0, le=1.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]


class MatchSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a curve must show to be taken for a landmark."""

    window_s: Positive = 2.0
    """Time over which yaw rate and speed are averaged (services/odometry_fusion)."""
    lowest_speed_mps: Positive = 10.0 / 3.6
    """Below it curvature is not to be trusted (Iwata et al., section 3.2: 10 km/h)."""
    longest_step_s: Positive = 0.35
    """A longer time between two samples is a gap: three of ten per second may be missing."""
    leap_mps2: Positive = 4.0
    """Speed that changes faster (over half a second) is the wheel's, not the train's: no train brakes half as hard."""
    straight_per_m: Positive = 4e-4
    """Curvature below which track counts as straight, a radius of 2500 m; for flat curves 0.4/radius."""
    straight_share: Share = 0.9
    """Share of the straight's length that must be straight: 18 of 20 m."""
    straight_within_m: Positive = 120.0
    """The straight must lie within this distance of the lower limit's crossing."""
    scale_tolerance: Share = 0.2
    """How far the mean curvature of a curve may be from the database's, as a share: 15 % passes, 25 % never."""
    length_cap_share: Share = 0.2
    """The tolerance of the length is never more than this share of the length …"""
    length_floor_m: Positive = 6.0
    """… unless that is less than this."""
    shape_tolerance: Share = 0.1
    """Largest root mean square difference from the database's curvature, as a share of the arc's, after the scale."""
    lowest_confidence: Positive = 5.0
    """Standard deviations of noise that the bound allows for."""
    noise_per_s: NotNegative = 6e-4
    """Yaw rate's noise after averaging [rad/s], where the odometry states no sigma; 0.035 degrees per second."""
    gyro_bias_radps: NotNegative = 1.75e-3
    """Largest bias of the yaw gyro, 0.1 degrees per second (Iwata et al., section 3.1.4)."""
    gyro_drift_radps: NotNegative = 3.5e-4
    """Largest change of it from one side of a curve to the other."""
    sensor_skew_s: NotNegative = 0.05
    """Largest error of the delay between inertial sensor and wheel, after calibration."""
    transition_model_m: NotNegative = 0.5
    """How far crossings of real transitions (cubic parabolas, car body between its bogies) are from a clothoid's."""
    share_bound: NotNegative = 0.02
    """Error of the distance outside slips where the odometry states none (Iwata et al.: 2 %)."""
