"""Messages about the train's place: references met, the position, what contradicts it.

Places along the line are `axis_m`, true metres along the axis of the main line or of the branch named
(schemas/line.py). Terms follow ETCS: estimated front end, max safe front end, min safe rear end,
under- and over-reading amount, reference and its location accuracy.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from schemas.line import Direction
from schemas.message import Message, Part

Metres = Annotated[float, Meta(ge=0.0)]
PositionStatus = Literal["valid", "degraded", "lost"]
Cab = Literal["A", "B"]


class TrainTruth(Message, frozen=True, kw_only=True):
    """Where a simulated train's antenna really is (only a simulator can know)."""

    lat_deg: float
    lon_deg: float
    h_m: float
    """Ellipsoidal height [m]."""
    ve_mps: float
    vn_mps: float
    vu_mps: float
    axis_m: float
    """True metres along the line's axis."""
    speed_mps: float
    surroundings: str = ""
    """What stands around the train here ('open', 'street canyon', …)."""


class MotionTruth(Message, frozen=True, kw_only=True):
    """Where a simulated train's front end really is and how its wheels turn."""

    axis_m: float
    """Of the front end."""
    branch: str = ""
    chainage_m: float
    distance_m: float
    """Gone since the simulation began."""
    speed_mps: float
    acceleration_mps2: float
    slip: Literal[-1, 0, 1]
    gradient_permille: float
    curvature_per_m: float


class LandmarkMatch(Message, frozen=True, kw_only=True):
    """A curve recognised, or refused, with the correction that follows; `t_ns` is the time of the exit crossing."""

    landmark: str
    branch: str = ""
    direction: Direction
    accepted: bool
    reason: str
    """Which diagnosis refused it, or 'accepted'."""
    origin: str
    """Of the odometry that measured it."""
    distance_m: float
    """Of the odometry at the exit crossing, delayed like the curvature."""
    axis_m: float
    """Of the front end at `t_ns`, by the landmark."""
    correction_m: float
    """`axis_m` minus the position held until then."""
    bound_m: Metres
    """Error of `axis_m` that is vouched for: location accuracy of the landmark and of the crossing."""
    database_version: str
    line_version: str


class BranchChance(Part, frozen=True, kw_only=True):
    """How likely the train is on one branch."""

    branch: str
    """Empty: the main line."""
    probability: Annotated[float, Meta(ge=0.0, le=1.0)]


class BranchEvidence(Message, frozen=True, kw_only=True):
    """On which branch the curvature profile says that the train is."""

    junction_axis_m: float
    decided: str | None
    """Branch once it is certain enough; None before."""
    chances: tuple[BranchChance, ...]
    reason: str


class BalisePassage(Message, frozen=True, kw_only=True):
    """A balise passed; real equipment feeds this."""

    balise: str
    sensor_offset_m: float = 0.0
    """How far the reader is behind the front end."""
    detection_bound_m: Metres = 1.0
    """Error of the moment of passing, in metres."""


class TrainChange(Message, frozen=True, kw_only=True):
    """Something about the train that its position depends on has changed, as the train's equipment or a person says."""

    kind: Literal["cab", "coupled", "uncoupled", "wheel_turned", "moved_cold", "route"]
    cab: Cab | None = None
    """`cab`: which end leads now."""
    length_m: Metres | None = None
    """`coupled`, `uncoupled`: length from now on."""
    front_shift_m: float | None = None
    """`coupled`, `uncoupled`: by how much the front end moved forward."""
    wheel_diameter_m: Metres | None = None
    branch: str | None = None
    """`route`: branch that is set; empty for the main line."""
    track: str | None = None
    note: str = ""


class Stretch(Part, frozen=True, kw_only=True):
    """A stretch of one branch."""

    branch: str
    start_axis_m: float
    end_axis_m: float


class SourceState(Part, frozen=True, kw_only=True):
    """What one source says of the position, and how it was taken."""

    source: Literal["odometry", "landmark", "gnss", "balise", "restart", "route"]
    taken: bool
    age_s: float
    difference_m: float | None = None
    """Its place minus the position held."""
    allowed_m: Metres | None = None
    """How much of that the bounds explain."""
    reason: str


class TrainPosition(Message, frozen=True, kw_only=True):
    """Where the train is, and between which places it is certain to be."""

    status: PositionStatus
    reason: str
    branch: str | None = None
    """Empty: the main line; None while it is undecided."""
    track: str | None = None
    """Of parallel tracks, empty for the axis itself; None while it is undecided or there is one only."""
    axis_m: float | None = None
    """Estimated front end."""
    chainage_m: float | None = None
    direction: Direction | None = None
    """Towards which the front end looks; None until it is known."""
    speed_mps: float | None = None
    """Positive in the direction of the front end."""
    speed_bound_mps: Metres | None = None
    bound_ahead_m: Metres | None = None
    """Under-reading amount: how far ahead of the estimate the front end may be."""
    bound_behind_m: Metres | None = None
    """Over-reading amount: how far behind it."""
    max_safe_front_end_m: float | None = None
    """`axis_m` of the foremost place that the train may reach to."""
    min_safe_front_end_m: float | None = None
    min_safe_rear_end_m: float | None = None
    """`axis_m` of the rearmost place that it may reach back to."""
    train_length_m: Metres | None = None
    occupied: tuple[Stretch, ...] = ()
    """From the min safe rear end to the max safe front end, on every branch that is possible."""
    standstill: bool = False
    slip: Literal[-1, 0, 1] = 0
    reference: str = ""
    """Last reference: landmark, balise, GNSS."""
    reference_distance_m: Metres | None = None
    """Way gone since then."""
    clock_bound_m: Metres = 0.0
    """Metres that the clock's offset adds, contained in the bounds."""
    sources: tuple[SourceState, ...] = ()
    stop_demanded: bool = False
    line_version: str = ""


class ReferencePass(Message, frozen=True, kw_only=True):
    """A balise or landmark passed: how wrong the position was there, against its bound."""

    reference: str
    kind: Literal["landmark", "balise"]
    axis_m: float
    error_m: float
    """Position held minus the reference's place."""
    bound_m: Metres
    """Bound held towards that side, plus the reference's own."""
    within: bool
    way_m: Metres
    """Gone since the reference before."""


class PositionEvent(Message, frozen=True, kw_only=True):
    """Something that people should know about the position."""

    kind: Literal[
        "status", "contradiction", "reset", "branch", "direction", "stop_demand", "line_version", "restart", "change"
    ]
    text: str
    axis_m: float | None = None
    chainage_m: float | None = None


FaultKind = Literal[
    "slide",
    "spin",
    "micro_slip",
    "gnss_lost",
    "gyro_bias",
    "accelerometer_bias",
    "imu_frozen",
    "imu_lost",
    "imu_saturated",
    "imu_axes_swapped",
    "imu_late",
    "tacho_stuck",
    "tacho_lost",
    "tacho_missing_teeth",
    "tacho_reset",
    "tacho_late",
    "radio_interference",
    "radio_obstruction",
    "radio_snow",
    "radio_degradation",
    "radio_dead",
]
"""What can go wrong with a simulated train, its sensors, and the radios along its line."""


class SimulatorFault(Message, frozen=True, kw_only=True):
    """A fault to be switched on or off in a simulated train."""

    kind: FaultKind
    active: bool = True
    magnitude: float | None = None
    """By kind: m/s of the wheel against the train (`slide`, `spin`), share of speed (`micro_slip`), rad/s, m/s²,
    seconds (`imu_late`, `tacho_late`), missing teeth, share of the usual span (`imu_saturated`), sent power in dBm
    (`radio_interference`), dB (`radio_obstruction`, `radio_snow`), dB per day (`radio_degradation`); None: a usual
    one."""
    duration_s: Metres | None = None
    """None: until it is switched off."""
    start_axis_m: float | None = None
    """Radio: where the stretch begins; an interferer stands in its middle. None: the whole line."""
    end_axis_m: float | None = None
    radio: str = ""
    """Radio: the wayside radio it befalls; empty: all of them (`radio_dead`: the train's own device)."""
    channel: str = ""
    """Radio: the channel it befalls; empty: all of them."""
