"""Settings of a train's motion and of the sensors that feel it, as frozen structs with limits.

They are tables of a scenario (docs/simulator.md) and arguments of `simulate_motion_log`. Angles in
degrees here, for people write them; radians everywhere else.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
SlipKind = Literal["cycling", "controlled", "locked", "creeping", "micro", "breaking_away"]
Grade = Literal["adis16480", "mems"]


class Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of a scenario file."""


class Vehicle(Part, frozen=True, kw_only=True):
    """A train, as its motion and its measured axle need it."""

    length_m: Positive = 60.0
    bogie_base_m: Positive = 13.8
    """Between the bogie centres of the car with the inertial sensor."""
    wheel_diameter_m: Annotated[float, Meta(gt=0.2, lt=2.0)] = 0.816
    """Nominal."""
    teeth: Annotated[int, Meta(ge=1, le=10_000)] = 90
    max_traction_mps2: Positive = 0.75
    """Tractive effort over mass at the start."""
    power_w_per_kg: Positive = 8.0
    """Beyond v = power / max_traction effort falls with 1/v."""
    service_brake_mps2: Positive = 0.95
    max_speed_mps: Positive = 30.0
    jerk_mps3: Positive = 0.7
    davis_a_mps2: NotNegative = 0.012
    """Running resistance over mass: a + b v + c v²."""
    davis_b_per_s: NotNegative = 1.3e-4
    davis_c_per_m: NotNegative = 1.4e-5
    traction_load: NotNegative = 1.8
    """Effort at the measured axle over the train's mean; 0: not driven."""
    brake_load: NotNegative = 1.0
    """The same in braking; 0: not braked."""
    rotating_mass_share: Positive = 0.14
    """Inertia of the measured wheelset over the mass that it carries."""
    pitch_per_mps2: float = 0.0016
    """Nose up per longitudinal acceleration on the suspension [rad per m/s²]."""
    roll_flexibility: NotNegative = 0.25
    """Roll of the body on the suspension over the cant deficiency angle."""


CONVENTIONAL = Vehicle()
"""Conventional train of three cars, first axle, driven (Iwata et al., table 2)."""
AXLE_LOAD_CONTROLLED = Vehicle(
    length_m=12.0,
    bogie_base_m=7.0,
    wheel_diameter_m=0.502,
    teeth=102,
    max_traction_mps2=0.9,
    power_w_per_kg=7.0,
    max_speed_mps=20.0,
    traction_load=0.0,
    brake_load=0.6,
    rotating_mass_share=0.06,
    pitch_per_mps2=0.0035,
)
"""Road-rail car with axle load control: front guide wheels, braked, not driven (Iwata et al., table 2)."""
IDLE_AXLE = msgspec.structs.replace(AXLE_LOAD_CONTROLLED, brake_load=0.0)
"""The same car by its rear guide wheels, neither driven nor braked."""
VEHICLES = {"conventional": CONVENTIONAL, "axle_load_controlled": AXLE_LOAD_CONTROLLED, "idle_axle": IDLE_AXLE}


class Driving(Part, frozen=True, kw_only=True):
    """How the driver drives; what is a range is drawn anew for each leg."""

    margin_mps: tuple[float, float] = (0.5, 2.5)
    """Below the limit."""
    band_mps: tuple[float, float] = (1.0, 4.0)
    """Coasts until the speed has fallen by this, then powers again."""
    brake_mps2: tuple[float, float] = (0.5, 0.8)
    """Planned deceleration to stops and restrictions."""
    power_share: tuple[float, float] = (0.6, 1.0)
    """Of the full tractive effort."""
    dwell_s: tuple[float, float] = (20.0, 45.0)


class Episode(Part, frozen=True, kw_only=True):
    """Low adhesion at a time or a place."""

    kind: SlipKind = "cycling"
    at_s: NotNegative | None = None
    """Since the start; else `at_axis_m`, else at random."""
    at_axis_m: float | None = None
    """Each time the front end gets here."""
    duration_s: Positive = 6.0
    adhesion: Share = 0.5
    """Adhesion at hand, as a share of what is asked for at the onset."""
    slip: Positive = 0.15
    """Slip that brakes or traction settle at, as a share of speed (`controlled`, `creeping`, `micro`); the most that
    a wheel `breaking_away` comes to."""


class Adhesion(Part, frozen=True, kw_only=True):
    """Between wheel and rail."""

    random_gap_s: Positive | None = None
    """Mean time from one slip drawn at random to when the next may begin; None: none are drawn."""
    shortest_gap_s: NotNegative = 25.0
    slide_share: Share = 0.65
    """Slides among them; the others are spins."""
    duration_median_s: Positive = 5.0
    """Log-normal, cut to 2.5 to 15 s: about 90 % last less than 10 s."""
    duration_sigma: NotNegative = 0.5
    weights: dict[SlipKind, NotNegative] = msgspec.field(
        default_factory=lambda: {"cycling": 0.4, "controlled": 0.25, "locked": 0.08, "creeping": 0.17, "micro": 0.1}
    )
    micro_slip: NotNegative = 1.0
    """Times the usual few per mille of creep under effort."""
    build_up: NotNegative = 1.0
    """Times the usual length of the micro-slip before and after a wheel breaks away (`breaking_away`)."""
    build_up_speed: NotNegative = 1.0
    """Times its usual speed."""
    dry_mps2: Positive = 2.2
    """Adhesion at hand on a dry rail, over mass."""
    episodes: tuple[Episode, ...] = ()


class Imu(Part, frozen=True, kw_only=True):
    """An inertial sensor, 100 Hz."""

    grade: Grade = "adis16480"
    latency_s: Annotated[float, Meta(ge=0.0, le=3.0)] = 0.3
    """A sample is stamped this late."""
    behind_front_m: float = 0.0
    noise: NotNegative = 1.0
    gyro_bias_dps: NotNegative | None = None
    """Size of the residual bias of every axis, its sign drawn; None: drawn from the grade's spread."""
    accelerometer_bias_mps2: NotNegative | None = None
    temperature_change_c: float = 8.0
    """From switching on until warm."""
    warm_up_s: Positive = 900.0
    vibration: NotNegative = 1.0
    mounting_deg: tuple[float, float, float] | None = None
    """Roll, pitch, yaw of the sensor in the body; None: drawn."""
    mounting_sigma_deg: NotNegative = 0.3
    distortion: NotNegative = 1.0
    """Of scale factors and axes, against the grade's spread."""


class Tacho(Part, frozen=True, kw_only=True):
    """A pulse counter on the measured axle."""

    rate_hz: Literal[10, 100] = 10
    wheel_scale: Annotated[float, Meta(gt=-0.2, lt=0.2)] | None = None
    """True over nominal diameter, minus 1; None: drawn, for wheels wear."""
    wheel_scale_sigma: NotNegative = 0.003
    missing_teeth: Annotated[int, Meta(ge=0)] = 0
    counter_bits: Annotated[int, Meta(ge=0, le=62)] = 0
    """Width of the counter, which wraps; 0: never."""
    tells_direction: bool = True


class MotionSettings(Part, frozen=True, kw_only=True):
    """Everything about one train but its track."""

    vehicle: Vehicle = CONVENTIONAL
    driving: Driving = Driving()
    adhesion: Adhesion = Adhesion()
    imu: Imu = Imu()
    tacho: Tacho = Tacho()
    max_gradient_permille: Positive = 35.0
    """What the motion log states of the line."""
