"""Every parameter of the paper's method, with the reading of the text that works (docs/odometry_fusion.md)."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

NotNegative = Annotated[float, Meta(ge=0.0)]
Positive = Annotated[float, Meta(gt=0.0)]
PitchCorrection = Literal["none", "constant", "yaw", "yaw_and_roll"]


class PaperSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Parameters of Iwata et al.; km/h/s and km/h/s per 0.1 s as in the text."""

    window_s: Annotated[float, Meta(ge=0.2, le=5.0)] = 3.0
    """Moving average of every signal (section 4.1)."""
    speed_window_s: Annotated[float, Meta(ge=0.1, le=2.0)] = 1.0
    """Speeds of the wheel whose difference over the window is Ap are taken over so long."""
    detection_kmhps: Positive | None = None
    """Ta of equation (1). None: what the steepest gradient of the vehicle's line shows, and `headroom_kmhps`."""
    headroom_kmhps: NotNegative = 0.37
    """Added to the steepest gradient's share for Ta. The paper has none (1.23 for 35 per mille) and its line 16 per
    mille; on lines as steep as the limit Ta would be crossed by gradients alone."""
    look_back_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 2.1
    """The search for the start point begins so long before detection (section 4.3.1)."""
    search_s: Annotated[float, Meta(ge=0.3, le=30.0)] = 12.0
    """The search goes back so far; the paper gives no limit."""
    jerk_imu_kmhps: Positive = 0.15
    """Largest |Ji| at a start point, per 0.1 s."""
    jerk_wheel_kmhps: Positive = 0.15
    """Largest |Jp| at a start point, per 0.1 s."""
    jerk_difference_kmhps: Positive = 0.05
    """Largest |Ji - Jp| at a start point, per 0.1 s (section 4.3.1)."""
    periods: Annotated[int, Meta(ge=1, le=20)] = 3
    """Consecutive periods that must agree: start point (section 3.1.2) and re-adhesion."""
    pitch_correction: PitchCorrection = "yaw"
    """`none`: the pitch rate as measured; `constant`: pitch stays as at the start point; `yaw`: equation (5);
    `yaw_and_roll`: equation (12)."""
    start_points: Annotated[int, Meta(ge=1, le=8)] = 4
    """Start points that are followed at once, the first to re-adhere counts (section 4.3.1 suggests several)."""
    start_point_spacing_s: Annotated[float, Meta(ge=0.1, le=10.0)] = 2.5
    """Least time between them."""
    beta_kmhps: Positive = 0.15
    """Largest difference of speed at re-adhesion per second of correction. The paper gives no figure."""
    jerk_at_readhesion: bool = False
    """Whether re-adhesion takes the jerk criteria, too (section 4.3.1 suggests it)."""
    watches_stamps: bool = True
    """Whether Ta, the jerk criteria and ③ of equation (13) widen where the times of the counts jitter."""
    longest_correction_s: Annotated[float, Meta(ge=5.0, le=120.0)] = 30.0
    """Without re-adhesion until then a stop is demanded."""
    gyro_error_dps: Positive = 0.1
    """① of equation (13) at `bias_hold_s` after the last standstill; half of it right after."""
    bias_hold_s: Positive = 1_800.0
    """The paper resets its sensors about every 30 minutes."""
    accelerometer_error_kmhps: NotNegative = 0.1
    """② of equation (13)."""
    threshold_error_kmhps: NotNegative = 0.25
    """③ of equation (13). The paper takes 1.23, the steepest gradient once more, for a start point chosen by jerk."""
    share: Annotated[float, Meta(ge=0.0, le=0.2)] = 0.02
    """Relative error of distance outside slips (section 4.3.1)."""
    wear_share: Annotated[float, Meta(ge=0.0, le=0.1)] = 0.015
    """Added to it: a wheel that is off by the 2 % alone leaves nothing for micro-slip, which the paper's line had
    little of."""
    undetected_m: NotNegative = 2.0
    """What a slip may cost before it is detected."""
    cap_m: NotNegative = 4.99
    cap_share: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.05
    """While all is well the bound is not stated above this constant and share of distance, the accuracy asked of ETCS
    odometry: (13) is cautious, and errors stayed far below (docs/odometry_fusion.md)."""
