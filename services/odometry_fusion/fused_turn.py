"""Whether an inertial sensor turned about the vertical, by whatever angle, could make a slip seem one.

If the wheel were right in what looks like a slip, and the sensor turned by α since, then, freed from gravity,

    ax cos α + ay sin α  would be the wheel's acceleration,  -ax sin α + ay cos α  its speed times the yaw rate.

Both are integrated from where the slip shows, gravity by the gyros, which are turned, too. All of it is linear in cos α
and sin α, so that a few sums serve every angle. Where none fits, y shows as little as it does of a sensor that looks
forward, and the slip goes with the effort that x shows, the sensor is not turned, and the wheel slips.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_layout import GRAVITY_MPS2, SLIPPING, TH, B, Branches, C, Record, State, U, V

OPEN: Final = 0
FORWARDS: Final = 1
UNKNOWN: Final = 2
"""Whether it looks forward: not told yet, it does, cannot be told in this slip."""
ANGLES: Final = 24
SHOWN_MPS: Final = 0.2
"""A slip that has come to so much has shown: until then all begins anew."""
MISS_MPS: Final = 0.4
MISS_MPS2: Final = 0.05
MISS_SHARE: Final = 0.75
"""What gravity, mounting and noise may hide of a turned sensor: at once, per second, and as a share of the slip."""
FITS_MPS: Final = 1.0
FITS_SHARE: Final = 0.4
"""A slip of so much of which an angle leaves less than this share speaks for that angle."""
QUIET_MPS: Final = 0.3
QUIET_MPS2: Final = (0.05, 0.1)
"""What y may show of a sensor that looks forward: at once, and per second, before it is found to and afterwards."""
PROOF: Final = 0.5
"""Evidence for x looking forward, (m/s²)² s, that x must have shown since sensors last contradicted each other."""
SETTLED_S: Final = 10.0
"""So long the roll angle takes."""


@kernel
def watch_turns(tick: Record, now: Record, branches: Branches, blind: bool, dt_s: float) -> None:  # noqa: FBT001 - a kernel takes its arguments by place
    """Take one tick into the accounts of slips."""
    now.shown = 0.0 if now.turned or now.distrust_s > 0.0 else max(now.shown, now.not_turned)
    for i in range(now.branches):
        own = branches.about[i]
        if own.mode != SLIPPING:
            continue
        x = branches.x[i]
        own.apart_m = (own.apart_m if own.turn_since >= own.slip_since else 0.0) + abs(x[U]) * dt_s
        if own.turn_since < own.slip_since or (own.facing == OPEN and abs(x[U]) < SHOWN_MPS):
            _begin(own, x, now)
        if blind:
            own.facing = UNKNOWN
        if own.facing != UNKNOWN:
            _take_in(tick, now, own, x, dt_s)
            _look(own, x, (now.tick - own.turn_since) * dt_s)


@kernel
def _begin(own: Record, x: State, now: Record) -> None:
    own.turn_since = now.tick
    own.facing = OPEN if now.shown > PROOF and now.roll_settled_s > SETTLED_S and not own.first else UNKNOWN
    own.pitch_c, own.pitch_s, own.pitch_1 = 0.0, 0.0, x[TH]
    own.roll_c, own.roll_s, own.roll_1 = 0.0, 0.0, now.roll_rad
    own.rolled_c, own.rolled_s, own.rolled_1 = 0.0, 0.0, 0.0
    own.ahead_c, own.ahead_s, own.ahead_1 = 0.0, 0.0, 0.0
    own.shown_x_mps, own.shown_y_mps = 0.0, 0.0
    own.curved_rim_mps, own.curved_mps = 0.0, 0.0
    own.first_rim_mps = x[V] + x[U]


@kernel
def _take_in(tick: Record, now: Record, own: Record, x: State, dt_s: float) -> None:
    gx = tick.gx_radps - now.roll_bias_radps
    gz = tick.gz_radps - now.yaw_bias_radps
    nose = -tick.gy_radps + x[B] + x[C] * gz
    own.shown_x_mps += tick.ax_mps2 * dt_s
    own.shown_y_mps += tick.ay_mps2 * dt_s
    own.curved_rim_mps += (x[V] + x[U]) * gz * dt_s
    own.curved_mps += x[V] * gz * dt_s
    own.ahead_c += (tick.ax_mps2 - GRAVITY_MPS2 * own.pitch_c) * dt_s
    own.ahead_s += (tick.ay_mps2 - GRAVITY_MPS2 * own.pitch_s) * dt_s
    own.ahead_1 -= GRAVITY_MPS2 * own.pitch_1 * dt_s
    own.rolled_c += own.roll_c * dt_s
    own.rolled_s += own.roll_s * dt_s
    own.rolled_1 += own.roll_1 * dt_s
    pitch_c, pitch_s, pitch_1 = own.pitch_c, own.pitch_s, own.pitch_1
    own.pitch_c += (nose + gz * own.roll_c) * dt_s
    own.pitch_s += (gx + gz * own.roll_s) * dt_s
    own.pitch_1 += gz * own.roll_1 * dt_s
    own.roll_c += (gx - gz * pitch_c) * dt_s
    own.roll_s -= (nose + gz * pitch_s) * dt_s
    own.roll_1 -= gz * pitch_1 * dt_s


@kernel
def least_miss(own: Record, rim_mps: float) -> float:
    """By how much a turned sensor fails to show the rim's motion at least, whatever the angle [m/s]."""
    least_mps = np.inf
    gained_mps = rim_mps - own.first_rim_mps
    for k in range(ANGLES):
        c, s = np.cos(2.0 * np.pi * k / ANGLES), np.sin(2.0 * np.pi * k / ANGLES)
        ahead = own.ahead_c * c + own.ahead_s * s + own.ahead_1 - gained_mps
        rolled = GRAVITY_MPS2 * (own.rolled_c * c + own.rolled_s * s + own.rolled_1)
        aside = own.shown_y_mps * c - own.shown_x_mps * s - own.curved_rim_mps - rolled
        least_mps = min(least_mps, max(abs(ahead), abs(aside)))
    return least_mps


@kernel
def aside_of(own: Record) -> float:
    """What y has shown beyond curve and roll, of a sensor that looks forward [m/s]."""
    return float(own.shown_y_mps - own.curved_mps - GRAVITY_MPS2 * (own.rolled_c + own.rolled_1))


@kernel
def _look(own: Record, x: State, slip_s: float) -> None:
    """Judge. Once y has shown what it should not, or an angle has fitted, nothing is told in this slip any more."""
    slip_mps = abs(x[U])
    if abs(aside_of(own)) > QUIET_MPS + QUIET_MPS2[own.facing] * slip_s:
        own.facing = UNKNOWN
    elif own.facing == OPEN and slip_mps > MISS_MPS:
        missed_mps = least_miss(own, x[V] + x[U])
        if slip_mps > FITS_MPS and missed_mps < FITS_SHARE * slip_mps:
            own.facing = UNKNOWN
        elif x[U] * own.shown_x_mps > 0.0 and missed_mps > max(MISS_MPS + MISS_MPS2 * slip_s, MISS_SHARE * slip_mps):
            own.facing = FORWARDS
