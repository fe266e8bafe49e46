"""State of one branch of the fused mode, what is kept of each branch and of all, and what comes out.

A branch is one account of what the wheels have done so far ("adhering", "slipping since …"). Its state, in metres of
the wheel's nominal diameter:

D  way of the train [m]                      W  way of the wheel's rim [m]
V  speed of the train [m/s]                  TH angle by which gravity shows on the x axis, nose up [rad]
B  what the pitch rate lacks [rad/s]         C  share of the yaw rate that leaks into the pitch rate
M  turn of the sensor about z [rad]          L  lead of the wheel over the inertial sensor [s]
U  speed of the rim over the ground [m/s]: micro-slip while adhering, the slip itself in a slip

The accelerometer's bias and the mounting's pitch angle cannot be told from the track's gradient and need not be:
all three are TH. L also takes what micro-slip is in proportion to tractive effort.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.odometry_fusion.motion_log import Floats
from services.odometry_fusion.tick_layout import Records

D: Final = 0
W: Final = 1
V: Final = 2
TH: Final = 3
B: Final = 4
C: Final = 5
M: Final = 6
L: Final = 7
U: Final = 8
SIZE: Final = 9
"""Unknowns of a branch."""
BRANCHES: Final = 16
"""Accounts kept from one tick to the next."""
ROOM: Final = 3 * BRANCHES
"""Accounts while new ones are tried: each may begin a slip, and end one in two ways."""
ADHERING: Final = 0
SLIPPING: Final = 1
GRAVITY_MPS2: Final = 9.80665

Record = Any
"""One element of a record array, its fields by name."""
State = Floats
"""Shape (SIZE,)."""
Covariance = NDArray[np.float64]
"""Shape (SIZE, SIZE)."""

BRANCH: Final[np.dtype[Any]] = np.dtype([
    ("mode", np.int64),
    # tick at which the mode began, and its latest slip
    ("since", np.int64),
    ("slip_since", np.int64),
    # when the slip ended the wheel's speed was taken over against the inertial one, or that was hardly known
    ("free", np.int64),
    # the account that the wheels slipped when all began
    ("first", np.int64),
    # direction that its latest slip has shown: -1, 0 or +1
    ("shown", np.int64),
    # in its latest slip the rim has long run as a train does
    ("tame", np.int64),
    # `fused_turn`: the slip that it looks at, and what it has found
    ("turn_since", np.int64),
    ("facing", np.int64),
    *(
        (name, np.float64)
        for name in (
            "log_weight",
            # intensity of the slip speed's random walk [m²/s³], as it goes, and the largest slip speed so far
            "walk",
            "top_mps",
            # D and W where its latest slip began
            "slip_d_m",
            "slip_w_m",
            # effort at the wheels then [m/s²]
            "effort_mps2",
            # way on which wheel and inertial sensor differed in slips whose end settled nothing [m]
            "doubt_m",
            # largest variance of its speed in its latest slip
            "loose_var",
            # `fused_turn`: since the slip began, of a sensor turned by any angle, what goes with its cosine (c), its
            # sine (s), and neither: pitch and roll [rad], roll over time [rad s], speed forwards [m/s]
            "pitch_c",
            "pitch_s",
            "pitch_1",
            "roll_c",
            "roll_s",
            "roll_1",
            "rolled_c",
            "rolled_s",
            "rolled_1",
            "ahead_c",
            "ahead_s",
            "ahead_1",
            # what x and y have shown [m/s], and what a curve adds to y at the rim's speed and at the account's [m/s]
            "shown_x_mps",
            "shown_y_mps",
            "curved_rim_mps",
            "curved_mps",
            "first_rim_mps",
            # way on which rim and account have been apart in its latest slip, either way [m]
            "apart_m",
        )
    ),
])  # fmt: skip
"""What is kept of a branch beside state and covariance."""


class Branches(NamedTuple):
    """All accounts; the first `now.branches` rows are in use."""

    x: NDArray[np.float64]
    """Shape (ROOM, SIZE)."""
    p: NDArray[np.float64]
    """Shape (ROOM, SIZE, SIZE)."""
    about: Records
    """Shape (ROOM,) of BRANCH."""


NOW: Final[np.dtype[Any]] = np.dtype([
    *(
        (name, np.int64)
        for name in (
            "tick",
            "branches",
            # ticks for which the wheel has stood; for which it has been followed
            "still",
            "followed",
            "standing",
            # -1, 0 or +1 as published, its branch's beginning, its number, and what has been said of it
            "slip",
            "slip_since",
            "slip_tick",
            "slip_ended",
            "hold",
            "episode",
            "overdue",
            # branch that is believed
            "best",
            # ticks for which all has been calm; for which no inertial sample was usable
            "calm",
            "unsettled",
            # counts missing: ticks until they are used again, and for which the inertial sensor was missing, too
            "returning",
            "both_ticks",
            # the inertial sensor is turned about the vertical; tick at which the rim was last wild
            "turned",
            "wild_tick",
            # the rim has been wild, and has not turned calmly since
            "broken",
            # x has shown the wheel's acceleration since the sensors last contradicted each other
            "proven",
        )
    ),
    *(
        (name, np.float64)
        for name in (
            "rest_s",
            "since_rest_s",
            "rested_s",
            "roll_bias_radps",
            "yaw_bias_radps",
            "roll_rad",
            "roll_settled_s",
            # last means of ax and of the pitch rate, and their variances from one to the next
            "ax_mps2",
            "gy_radps",
            "force_var",
            "rate_var",
            "noise_s",
            # last ways of the rim; sums behind the jitter of their times [m²], [m²/s²]
            "z1_m",
            "z2_m",
            "z3_m",
            "rim_mps",
            "jitter_m2",
            "jitter_mps2",
            # micro-slip's variance, and how well innovations agree with it
            "creep_var",
            "agreement",
            # share of the inertial noise that adds up
            "quiet",
            "slip_share",
            "slip_top",
            # effort at the wheels: smoothed specific force along x
            "effort_mps2",
            "acceleration_mps2",
            # distance published = scale (D - origin_d_m) + origin_m
            "scale",
            "scale_sigma",
            "origin_d_m",
            "origin_m",
            "live_d_m",
            "way_m",
            "distance_m",
            "excess_m",
            "owed_m",
            "settled_var",
            # way of the wheel when it last moved
            "stood_m",
            "gap_m",
            # gap in the counts: its length, the way before it and what came over it
            "gap_s",
            "count_m",
            "came_m",
            # by how much both sensors are late, and the range of speeds since
            "late_s",
            "late_least_mps",
            "late_most_mps",
            # `inertial_axes`: smoothed, and slowly changing, accelerations of rim and sensor; evidence
            "axes_s",
            "smooth_rim_mps",
            "smooth_ax_mps2",
            "smooth_ay_mps2",
            "mean_rim_mps2",
            "mean_ax_mps2",
            "mean_ay_mps2",
            "left_turned",
            "right_turned",
            "not_turned",
            # the most of it since sensors last contradicted each other
            "shown",
            # `fused_rim`
            "fast_rim_mps",
            "train_mps",
            # part of the excess in which wheel and inertial sensor contradicted each other
            "contested_m",
            # for how long the inertial sensor is not believed
            "distrust_s",
            # D and W when all was last calm
            "calm_d_m",
            "calm_w_m",
            # what was vouched for before going over to another account, and where the train was then [m]
            "vouched_m",
            "followed_m",
        )
    ),
])  # fmt: skip
"""What is common to all branches."""

OUT: Final[np.dtype[Any]] = np.dtype([
    ("slip", np.int64),
    ("standstill", np.int64),
    ("status", np.int64),
    ("reason", np.int64),
    *(
        (name, np.float64)
        for name in (
            "distance_m",
            "way_m",
            "speed_mps",
            "speed_bound_mps",
            "acceleration_mps2",
            "bound_m",
            "excess_m",
            "provisional_m",
            "yaw_radps",
            "sensed_distance_m",
            "gradient_permille",
            "wheel_scale",
            "gyro_bias_radps",
            "since_rest_s",
        )
    ),
])  # fmt: skip

EVENT: Final[np.dtype[Any]] = np.dtype([
    *((name, np.int64) for name in ("row", "phase", "episode", "slip")),
    *((name, np.float64) for name in ("correction_s", "corrected_m", "bound_m")),
])  # fmt: skip
BEGAN: Final = 0
ENDED: Final = 1
NOT_FOUND: Final = 2
PHASES: Final = ("began", "ended", "not_found")

FINE: Final = 0
IN_SLIP: Final = 1
OVERDUE: Final = 2
NO_IMU: Final = 3
NO_PULSES: Final = 4
NO_SENSOR: Final = 5
BEYOND: Final = 6
LATE: Final = 7
TURNED: Final = 8
UNCONFIRMED: Final = 9
CONTRADICTED: Final = 10
REASONS: Final = (
    "",
    "wheels slip: distance by the inertial sensor",
    "re-adhesion is not found in time",
    "no inertial sensor: slips are not seen",
    "no pulses: distance by the inertial sensor",
    "neither pulses nor inertial sensor",
    "the error may exceed 5 m + 5 % of the way",
    "both sensors were missing and the counter stood: they may be late since",
    "the inertial sensor is turned about the vertical: distance by the wheel",
    "begun while moving: the wheels may have slipped then",
    "the wheel runs smoothly and contradicts the inertial sensor: distance by the wheel",
)

RULES: Final[np.dtype[Any]] = np.dtype(
    [
        (name, np.float64)
        for name in ("pulse_m", "latency_s", "share", "longest_slip_s", "start_bound_m", "steepest_rad")
    ]
)
"""Settings and vehicle, see `fused_settings`."""
