"""How restless the sensors and the wheels are taken to be: by what the samples and the innovations show."""

from __future__ import annotations

from typing import Final

import numpy as np

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_hypotheses import against_effort, turned_over
from services.odometry_fusion.fused_layout import SLIPPING, Record, U, W
from services.odometry_fusion.motion_log import PERIOD_S, Floats

LEAST_FORCE_MPS2: Final = 0.02
LEAST_RATE_RADPS: Final = 1e-4
"""Standard deviations of a mean over a tick below which no sensor is believed."""
LEAST_CREEP: Final = 0.025
MOST_CREEP: Final = 0.3
"""Micro-slip's standard deviation [m/s]."""
AGREEMENT_SHARE: Final = 0.02
AGREEMENT: Final = 1.05
CREEP_GAIN: Final = 0.06
"""Micro-slip's variance follows the innovations: it grows while their squares exceed AGREEMENT times what the filter
expects, and falls while they stay below."""
LEAST_QUIET: Final = 0.01
"""Share of the noise seen from mean to mean that adds up over time: all of it if it is white, little of it if it
is vibration."""
LEAST_QUIET_SLIPPING: Final = 0.05
"""Of the pitch rate in a slip: no wheel is there to contradict, and vibration that is white adds up."""
AGREEING_TICKS: Final = 20
MOVING_MPS: Final = 3.0
LEAST_WALK: Final = 0.04
PLAIN_WALK: Final = 0.07
"""Least random walk of the slip speed, m/s per √s: while a slip is only suspected, and once it has shown. A slip
speed that then keeps still speaks for adhesion."""
MOST_WALK: Final = 4.0
WALK_SHARE: Final = 0.2
PLAIN_SLIP_MPS: Final = 0.25
"""A slip has shown above this slip speed and twice the micro-slip."""
SHOWN_MPS: Final = 0.15
"""A slip that has come to this has a direction, too."""


@kernel
def force_noise(now: Record) -> float:
    """Variance of the specific force's mean over a tick that adds up over time."""
    return float(max(now.quiet * now.force_var, LEAST_FORCE_MPS2**2))


@kernel
def rate_noise(own: Record, now: Record) -> float:
    """Variance of the pitch rate's mean over a tick that adds up over time."""
    quiet = max(now.quiet, LEAST_QUIET_SLIPPING) if own.mode == SLIPPING else now.quiet
    return float(max(quiet * now.rate_var, LEAST_RATE_RADPS**2))


@kernel
def watch_walk(x: Floats, p: Floats, own: Record, residual_m: float, variance: float, now: Record) -> None:
    """The slip speed's random walk follows what it has just done (as in GARCH models)."""
    shown = max(residual_m * residual_m - 4.0 * variance, 0.0) / PERIOD_S**3
    if own.shown == 0 and abs(x[U]) >= SHOWN_MPS:
        own.log_weight += against_effort(x[U], own.effort_mps2)
        own.shown = 1 if x[U] > 0.0 else -1
    elif x[U] * own.shown < 0.0 and abs(x[U]) >= SHOWN_MPS + np.sqrt(p[U, U]):
        own.log_weight += turned_over(x[U], own.effort_mps2, now.effort_mps2 if now.proven else 0.0)
        own.shown = -own.shown
    suspected = own.top_mps < PLAIN_SLIP_MPS + 2.0 * np.sqrt(now.creep_var)
    least = (LEAST_WALK if suspected else PLAIN_WALK) ** 2 + 2.0 * now.creep_var
    own.walk = max(least, own.walk + WALK_SHARE * (min(shown, MOST_WALK**2) - own.walk))
    own.top_mps = max(own.top_mps, abs(x[U]))


@kernel
def watch_creep(p: Floats, own: Record, residual_m: float, variance: float, now: Record) -> None:
    """Micro-slip's variance follows the innovations of the believed account while it adheres."""
    if now.slip != 0 or now.tick - own.since <= AGREEING_TICKS or abs(now.rim_mps) < MOVING_MPS:
        return
    score = min(residual_m * residual_m / (p[W, W] + variance), 9.0)
    now.agreement += AGREEMENT_SHARE * (score - now.agreement)
    more = np.exp(CREEP_GAIN * (now.agreement - AGREEMENT))
    if (more > 1.0 and now.quiet < 1.0) or (more < 1.0 and now.creep_var <= LEAST_CREEP**2):
        now.quiet = min(1.0, max(LEAST_QUIET, now.quiet * more))
    else:
        now.creep_var = min(MOST_CREEP**2, max(LEAST_CREEP**2, now.creep_var * more))
