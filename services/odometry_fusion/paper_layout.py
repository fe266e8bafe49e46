"""Records of the paper's method: smoothed signals, rules, inertial tracks, and what is kept between ticks."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from services.odometry_fusion.motion_log import PERIOD_S, Vehicle
from services.odometry_fusion.paper_settings import PaperSettings
from services.odometry_fusion.tick_layout import Records

GRAVITY_MPS2: Final = 9.80665
KMH: Final = 3.6
"""km/h per m/s."""

ADHERING: Final = 0
CORRECTING: Final = 1
OVERDUE: Final = 2
"""Re-adhesion was not found in time."""

NONE: Final = 0
CONSTANT: Final = 1
YAW: Final = 2
YAW_AND_ROLL: Final = 3
CORRECTIONS: Final = {"none": NONE, "constant": CONSTANT, "yaw": YAW, "yaw_and_roll": YAW_AND_ROLL}

Record = Any
"""One element of a record array, its fields by name."""
MOST_TRACKS: Final = 8
HISTORY: Final = 512
"""Ticks kept: the longest window, look-back and search fit."""


def _floats(*names: str) -> list[tuple[str, type[np.float64]]]:
    return [(name, np.float64) for name in names]


SMOOTHED: Final[np.dtype[Any]] = np.dtype([
    ("ready", np.int64),
    ("wheel_ready", np.int64),
    *_floats(
        # forces along the vehicle's axes, and the paper's rates: roll right side down, pitch nose up, yaw left
        "ax_mps2",
        "ay_mps2",
        "az_mps2",
        "roll_radps",
        "pitch_radps",
        "yaw_radps",
        # wheel: mean way, speed, acceleration Ap
        "way_m",
        "speed_mps",
        "wheel_mps2",
        # ax with the weights that Ap gives the window, for whatever sets the one against the other; changes of both
        # since the last tick
        "matched_mps2",
        "jerk_imu",
        "jerk_wheel",
    ),
])  # fmt: skip
"""Moving averages at one tick; `ready` and `wheel_ready` 0 while inertial samples or counts are missing in it."""

RULES: Final[np.dtype[Any]] = np.dtype([
    ("window", np.int64),
    ("speed_window", np.int64),
    ("look_back", np.int64),
    ("search", np.int64),
    ("latency", np.int64),
    ("periods", np.int64),
    ("correction", np.int64),
    ("start_points", np.int64),
    ("spacing", np.int64),
    ("jerk_at_readhesion", np.int64),
    ("watches_stamps", np.int64),
    *_floats(
        "latency_s",
        "pulse_m",
        "detection_mps2",
        "headroom_mps2",
        "jerk_imu",
        "jerk_wheel",
        "jerk_difference",
        "beta_mps2",
        "longest_s",
        "gyro_error_radps",
        "bias_hold_s",
        "accelerometer_error_mps2",
        "threshold_error_mps2",
        "share",
        "undetected_m",
        "cap_m",
        "cap_share",
    ),
])  # fmt: skip
"""The settings in ticks, m/s² and rad/s."""

TRACK: Final[np.dtype[Any]] = np.dtype([
    ("start_ns", np.int64),
    ("agreeing", np.int64),
    *_floats(
        # since the start point; attitude; the way and the speed that the inertial sensor gives, in smoothed time
        "t_s",
        "pitch_rad",
        "roll_rad",
        "forward_mps2",
        "speed_mps",
        "distance_m",
    ),
])  # fmt: skip
"""Inertial distance from one start point on."""

STATE: Final[np.dtype[Any]] = np.dtype([
    ("mode", np.int64),
    ("slip", np.int64),
    ("forced", np.int64),
    ("episode", np.int64),
    ("tracks", np.int64),
    ("ended_ns", np.int64),
    ("rest_ticks", np.int64),
    ("agreeing", np.int64),
    ("distrusted", np.int64),
    ("watched", np.int64),
    ("reopenable", np.int64),
    ("begun", np.int64),
    ("stamped", np.int64),
    ("jittering", np.int64),
    ("ended_slip", np.int64),
    ("tilted", np.int64),
    ("wrong_axes", np.int64),
    ("proven", np.int64),
    ("suspect", np.int64),
    *_floats(
        # distance = way + offset while adhering
        "offset_m",
        "start_offset_m",
        "run_m",
        "excess_m",
        # what the ends of this episode have added to it
        "closed_m",
        "gap_s",
        "gap_way_m",
        "since_rest_s",
        "roll_bias_radps",
        "pitch_bias_radps",
        "yaw_bias_radps",
        "rest_s",
        # what witnesses disagree on with the wheel, and the same with its sign
        "apart_m",
        "lead_m",
        # slip speed at which the latest witness has begun
        "inherited_mps",
        "unseen_m",
        "rest_ax_mps2",
        "rest_ay_mps2",
        "proof_s",
        "proof_x_mps",
        "proof_y_mps",
        # since the first count while the wheel has not been seen to adhere, -1 from then on; when wheel and inertial
        # sensor last differed meanwhile, and how far their speeds were apart
        "fresh_s",
        "fresh_until_s",
        "fresh_mps",
        # last ways at hand, and the variance of the times of the counts
        "z1_m",
        "z2_m",
        "z3_m",
        "jitter_s2",
    ),
])  # fmt: skip
"""What is kept between ticks."""

EVENT: Final[np.dtype[Any]] = np.dtype([
    ("row", np.int64),
    ("phase", np.int64),
    ("episode", np.int64),
    ("slip", np.int64),
    ("start_ns", np.int64),
    *_floats("correction_s", "corrected_m", "bound_m"),
])  # fmt: skip
"""Beginning (0), end (1) of an episode, or that none was found (2)."""

OUT: Final[np.dtype[Any]] = np.dtype([
    ("slip", np.int64),
    ("standstill", np.int64),
    ("status", np.int64),
    ("reason", np.int64),
    *_floats(
        "distance_m",
        "run_m",
        "speed_mps",
        "speed_bound_mps",
        "acceleration_mps2",
        "excess_m",
        "provisional_m",
        "bound_m",
        "gradient_permille",
        "gyro_bias_radps",
        "since_rest_s",
        "yaw_radps",
        "sensed_m",
    ),
])  # fmt: skip
"""What one tick gives; `sensed_m` is the distance at the instant that the inertial sample shows."""

REASONS: Final = (
    "",
    "no inertial samples: slips cannot be seen",
    "no pulses: way by the inertial sensor alone",
    "neither pulses nor inertial samples",
    "re-adhesion not found: stop demanded",
    "re-adhesion was not found since the last standstill",
    "the inertial sensor's axes do not fit the vehicle's",
    "the error may exceed 5 m + 5 % of the way",
    "begun in motion: the wheel has not been seen to adhere yet",
    "the times of the counts jitter: slips are seen late, and from uncertain start points",
)
NO_IMU: Final = 1
NO_PULSES: Final = 2
NO_SENSOR: Final = 3
NOT_FOUND: Final = 4
WAS_NOT_FOUND: Final = 5
WRONG_AXES: Final = 6
TOO_MUCH: Final = 7
FRESH: Final = 8
JITTERING: Final = 9


def rules_of(settings: PaperSettings, vehicle: Vehicle) -> Records:
    """The settings as the kernels take them, shape (1,)."""
    rules = np.zeros(1, RULES)
    steepest_mps2 = GRAVITY_MPS2 * vehicle.max_gradient_permille * 1e-3
    own_mps2 = steepest_mps2 + settings.headroom_kmhps / KMH
    window = max(2, round(settings.window_s / PERIOD_S))
    values = {
        "window": window,
        "speed_window": max(1, min(window // 2, round(settings.speed_window_s / PERIOD_S))),
        "look_back": round(settings.look_back_s / PERIOD_S),
        "search": round(settings.search_s / PERIOD_S),
        "latency": math.ceil(vehicle.imu_latency_s / PERIOD_S - 1e-6),
        "periods": settings.periods,
        "correction": CORRECTIONS[settings.pitch_correction],
        "start_points": settings.start_points,
        "spacing": round(settings.start_point_spacing_s / PERIOD_S),
        "jerk_at_readhesion": settings.jerk_at_readhesion,
        "watches_stamps": settings.watches_stamps,
        "pulse_m": vehicle.metres_per_pulse,
        "latency_s": vehicle.imu_latency_s,
        "headroom_mps2": settings.headroom_kmhps / KMH,
        "detection_mps2": own_mps2 if settings.detection_kmhps is None else settings.detection_kmhps / KMH,
        "jerk_imu": settings.jerk_imu_kmhps / KMH,
        "jerk_wheel": settings.jerk_wheel_kmhps / KMH,
        "jerk_difference": settings.jerk_difference_kmhps / KMH,
        "beta_mps2": settings.beta_kmhps / KMH,
        "longest_s": settings.longest_correction_s,
        "gyro_error_radps": float(np.radians(settings.gyro_error_dps)),
        "bias_hold_s": settings.bias_hold_s,
        "accelerometer_error_mps2": settings.accelerometer_error_kmhps / KMH,
        "threshold_error_mps2": settings.threshold_error_kmhps / KMH,
        "share": settings.share + settings.wear_share,
        "undetected_m": settings.undetected_m,
        "cap_m": settings.cap_m,
        "cap_share": settings.cap_share,
    }
    for name, value in values.items():
        rules[name] = value
    return rules
