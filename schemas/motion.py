"""Messages of motion: what inertial sensors and pulse counters measure, and the odometry made of it.

Axes of a vehicle: x forward, y left, z up, right-handed; accelerometers give specific force (at rest
+9.8 m/s² on z); angular rates are right-handed about these axes.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from schemas.arrays import Float64s, Int64s
from schemas.message import Message, require_columns

Metres = Annotated[float, Meta(ge=0.0)]
MotionStatus = Literal["valid", "degraded", "lost"]
WarningKind = Literal[
    "gap", "saturated", "frozen", "axes", "stuck", "reset", "late", "scale", "restart", "noise", "rate"
]
OdometryMethod = Literal["wheel", "paper", "fused"]


class ImuBlock(Message, frozen=True, kw_only=True):
    """Samples of one inertial sensor, oldest first; `t_ns` is the last one's. Columns have shape (n,)."""

    first_sample: Annotated[int, Meta(ge=0)]
    """Number of the first sample since the sensor started: a jump is a gap."""
    offset_ns: Int64s
    """Time of each sample relative to `t_ns`, never positive, rising."""
    ax_mps2: Float64s
    ay_mps2: Float64s
    az_mps2: Float64s
    gx_radps: Float64s
    gy_radps: Float64s
    gz_radps: Float64s
    temperature_c: float | None = None
    fault: str = ""
    """What the sensor or its reader finds wrong with these samples, in words (`saturated ax`, `frozen`); empty when
    all is well."""

    def __post_init__(self) -> None:
        """Refuse columns of different lengths."""
        count = len(self.offset_ns)
        require_columns(count, np.int64, offset_ns=self.offset_ns)
        require_columns(
            count,
            np.float64,
            ax_mps2=self.ax_mps2,
            ay_mps2=self.ay_mps2,
            az_mps2=self.az_mps2,
            gx_radps=self.gx_radps,
            gy_radps=self.gy_radps,
            gz_radps=self.gz_radps,
        )


class TachoBlock(Message, frozen=True, kw_only=True):
    """Counts of one axle's pulse counter, oldest first; `t_ns` is the last one's. Columns have shape (n,)."""

    first_sample: Annotated[int, Meta(ge=0)]
    offset_ns: Int64s
    pulses: Int64s
    """Cumulative, unwrapped by the reader; falls only where the axle turns backwards and the counter can tell."""
    resets: Annotated[int, Meta(ge=0)] = 0
    """How often the counter began anew since the reader started."""
    pulses_per_revolution: Annotated[float, Meta(gt=0.0)]
    wheel_diameter_m: Annotated[float, Meta(gt=0.0)]
    fault: str = ""

    def __post_init__(self) -> None:
        """Refuse columns of different lengths."""
        require_columns(len(self.offset_ns), np.int64, offset_ns=self.offset_ns, pulses=self.pulses)


class Odometry(Message, frozen=True, kw_only=True):
    """How far the train has gone since an origin, and the error that the method vouches for.

    Between two instants of one origin the error of the difference in distance is at most
    `share_bound` × way gone between them + rise of `excess_m` + `provisional_m` of both instants.
    """

    method: OdometryMethod
    origin: str
    """Names the zero of `distance_m`; another name means another zero."""
    distance_m: float
    """Signed: falls when the train runs backwards."""
    way_m: Metres
    """Way gone to and fro since the origin; never falls."""
    speed_mps: float
    speed_bound_mps: Metres
    acceleration_mps2: float | None = None
    slip: Literal[-1, 0, 1] = 0
    """-1 the wheel turns too slowly (slide), +1 too fast (spin), 0 it adheres."""
    standstill: bool = False
    bound_m: Metres
    """Error of `distance_m` since the origin, one side."""
    share_bound: Annotated[float, Meta(ge=0.0)]
    """Relative error of distance outside slips."""
    excess_m: Metres
    """What slips and gaps have added to the error for good; never falls."""
    provisional_m: Metres = 0.0
    """What an episode that has not ended adds for now."""
    status: MotionStatus
    reason: str = ""
    curvature_per_m: float | None = None
    """Of the track, positive to the left in the sense of forward running, mean over a window; None at low speed, in
    slips, without an inertial sensor."""
    curvature_sigma_per_m: float | None = None
    curvature_distance_m: float | None = None
    """`distance_m` delayed like `curvature_per_m`."""
    gradient_permille: float | None = None
    wheel_scale: float | None = None
    """Estimated true over nominal wheel diameter."""
    gyro_bias_radps: float | None = None
    since_standstill_s: float | None = None
    """Time since biases were last reset at rest."""
    sensor_delay_s: float = 0.0
    """By how much `t_ns` lags behind now because of alignment and averaging; the distance holds at `t_ns`."""


class SlipEpisode(Message, frozen=True, kw_only=True):
    """A slide or spin of the wheels, from its start point to re-adhesion; published when it begins and when it ends."""

    origin: str
    episode: Annotated[int, Meta(ge=0)]
    phase: Literal["began", "ended", "not_found"]
    """`not_found`: re-adhesion was not found in time, the train should be stopped."""
    slip: Literal[-1, 1]
    start_t_ns: int
    """Start point that was chosen."""
    correction_s: Metres
    """Correction time so far."""
    corrected_m: float | None = None
    """Distance by the inertial sensor minus distance by the wheel."""
    bound_m: Metres
    """Largest possible error of the episode (Iwata et al., equation 13, or the filter's own)."""
    stop_demanded: bool
    reason: str


class WheelScale(Message, frozen=True, kw_only=True):
    """Scale of the leading axle's wheels, as references at both ends of known distances tell it."""

    scale: Annotated[float, Meta(ge=0.5, le=2.0)]
    """True over nominal wheel diameter, 1 where nothing is known any more."""
    sigma: Annotated[float, Meta(gt=0.0, le=0.5)]
    """Its standard deviation: the scale of any stretch of way is within three of it."""
    references: Annotated[int, Meta(ge=0)]
    """Stretches between references that told it."""
    reason: str = ""


class MotionWarning(Message, frozen=True, kw_only=True):
    """Something wrong with a motion sensor or its mounting, found or gone."""

    device: str
    kind: WarningKind
    active: bool
    reason: str
