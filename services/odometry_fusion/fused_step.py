"""One tick of the fused mode after the other."""

from __future__ import annotations

from typing import Final

import numpy as np

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_branch import (
    ACCELERATION,
    CREEP,
    FIRST_SIGMAS,
    FORCE,
    RATE,
    WALK,
    begin_state,
    correct,
    predict,
)
from services.odometry_fusion.fused_gaps import bridge_gap, watch_gap
from services.odometry_fusion.fused_hypotheses import (
    TRY_TICKS,
    against_effort,
    begin_slip,
    branch_out,
    prune,
    slip_share,
)
from services.odometry_fusion.fused_layout import (
    ADHERING,
    GRAVITY_MPS2,
    SLIPPING,
    TH,
    B,
    Branches,
    D,
    M,
    Record,
    U,
    V,
    W,
)
from services.odometry_fusion.fused_output import publish
from services.odometry_fusion.fused_rim import begin_rim, watch_rim
from services.odometry_fusion.inertial_axes import forget_axes, watch_axes
from services.odometry_fusion.inertial_window import sense
from services.odometry_fusion.motion_log import PERIOD_S, Floats
from services.odometry_fusion.standstill import watch_standstill
from services.odometry_fusion.tick_layout import Records
from services.odometry_fusion.wheel_measure import rim_variance

LONGEST_HOLD_S: Final = 0.5
"""An inertial mean, or a count, is bridged for so long."""
FIRST_WAIT_S: Final = 0.35
"""The wheel's speed is known so long after the first count that the inertial sensor's latency has shown."""
MISSED_TEETH: Final = 3.0
"""So many should have come for a silent counter to be a missing one; less, and the wheel stands or creeps."""
LONGEST_STILL_S: Final = 120.0
"""A silent counter is taken for a standing wheel for at most so long."""
LEAST_FORCE_MPS2: Final = 0.02
LEAST_RATE_RADPS: Final = 1e-4
"""Standard deviations of a mean over a tick below which no sensor is believed."""
BLIND_ACCELERATION: Final = 0.25
"""Intensity [m²/s³] of an acceleration that is not measured: 0.5 m/s per √s."""
BLIND_RATE_VAR: Final = 9e-6 / PERIOD_S
"""Of a pitch that is not followed: gradients change by 3 per mille per √s."""
LEAST_CREEP: Final = 0.025
MOST_CREEP: Final = 0.3
"""Micro-slip's standard deviation [m/s]."""
FIRST_CREEP: Final = 0.04
AGREEMENT_SHARE: Final = 0.02
AGREEMENT: Final = 1.05
CREEP_GAIN: Final = 0.06
"""Micro-slip's variance follows the innovations: it grows while their squares exceed AGREEMENT times what the filter
expects, and falls while they stay below."""
FIRST_QUIET: Final = 0.05
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
EFFORT_SHARE: Final = 0.2
"""Of the newest in the effort."""
PROOF: Final = 1.0
"""Evidence for x looking forward, (m/s²)² s, before what it shows counts as effort."""
SHOWN_MPS: Final = 0.15
"""A slip that has come to this has a direction, too."""
FIRST_SLIP_LOG: Final = -3.0
FIRST_SLIP_S: Final = 4.0
FIRST_SLIP_MPS: Final = 1.5
FIRST_SLIP_SHARE: Final = 0.25
"""The wheels slip when all begins: how likely, for how long in the mean, and by how much (one sigma)."""
BACKWARDS_MPS: Final = 1.0
BACKWARDS_LOG: Final = 0.5
"""No train runs backwards while its wheels turn forwards: what an account of that loses per tick."""
LONGEST_TAME_S: Final = 25.0
TURNING_MPS: Final = 1.0
APART_SIGMA: Final = 3.0
APART_MPS: Final = 0.5
DISTRUST_S: Final = 30.0
"""After a slip in which the rim ran as smoothly as a train for so long, and so far from the inertial speed, the
inertial sensor is left out for so long. A small slip speed within its sigma contradicts nothing: slow slips
fade so."""
NEVER_TICKS: Final = 1_000_000
STILL_MPS: Final = 0.5
MOST_STILL_MPS: Final = 2.0
"""A standing wheel stands for a standing train if the account's speed is below these (and three sigma)."""
REST_SPEED_SIGMA_MPS: Final = 0.05
REST_RATE_SIGMA_RADPS: Final = 1e-3
RESTING_M: Final = 0.005
"""What a tick at rest changes of the way beyond this is owned: no wheel tells it."""


@kernel
def begin_now(now: Record) -> None:
    """What is known at the first count."""
    now.scale = 1.0
    now.force_var, now.rate_var = 0.1**2, 1e-3**2
    now.creep_var = FIRST_CREEP**2
    now.agreement, now.quiet = 1.0, FIRST_QUIET
    now.jitter_mps2 = 1.0
    now.best = 0
    now.wild_tick = -NEVER_TICKS


@kernel
def begin_branches(branches: Branches, now: Record, way_m: float, rim_m: float, speed_mps: float) -> None:
    """One account, adhering, of which nothing is known but where the wheel is and how fast it turns.

    And another, if it turns: that it slips already, the train being faster or slower.
    """
    begin_state(branches.x[0], branches.p[0])
    branches.x[0, D], branches.x[0, W] = way_m, rim_m
    branches.x[0, V] = speed_mps
    own = branches.about[0]
    own.mode, own.since, own.slip_since = ADHERING, now.tick, now.tick
    own.log_weight, own.walk, own.top_mps, own.free, own.first = 0.0, 0.0, 0.0, 0, 0
    own.tame, own.loose_var = 0, 0.0
    own.doubt_m = 0.0
    now.followed_m = way_m
    own.slip_d_m, own.slip_w_m = way_m, rim_m
    now.branches, now.best, now.settled_var = 1, 0, FIRST_SIGMAS[D] ** 2
    now.calm_d_m, now.calm_w_m = way_m, rim_m
    begin_rim(now)
    if abs(speed_mps) > STILL_MPS:
        begin_slip(branches, 0, 1, now.tick, 0.0)
        branches.about[1].log_weight, branches.about[1].first = FIRST_SLIP_LOG, 1
        variance = max(FIRST_SLIP_MPS, FIRST_SLIP_SHARE * abs(speed_mps)) ** 2
        p = branches.p[1]
        p[V, V] += variance
        p[U, U] += variance
        p[V, U] -= variance
        p[U, V] -= variance
        now.branches = 2


@kernel
def run_ticks(ticks: Records, rules: Records, state: Records, branches: Branches, out: Records, events: Records) -> int:
    """Rows for ticks; gives the number of events."""
    count = 0
    for row in range(len(ticks)):
        count = _step(ticks[row], row, rules[0], state[0], branches, out[row], events, count)
    return count


@kernel
def _step(
    tick: Record,
    row: int,
    rule: Record,
    now: Record,
    branches: Branches,
    out: Record,
    events: Records,
    count: int,
) -> int:
    away = tick.imu_missing_s > LONGEST_HOLD_S
    blind = away or now.turned > 0 or now.distrust_s > 0.0
    silent_s = tick.tacho_missing_s
    missed = abs(tick.wheel_speed_mps) * silent_s > MISSED_TEETH * tick.quantum_m or silent_s > LONGEST_STILL_S
    latency_ticks = int(np.ceil(rule.latency_s / PERIOD_S))
    silent = watch_gap(tick, now, blind, silent_s > LONGEST_HOLD_S and missed, latency_ticks)
    now.excess_m += tick.doubt_m
    stands = False
    if not np.isfinite(branches.x[now.best].sum() + branches.p[now.best].sum()):
        now.branches = 0
    if now.branches > 0:
        if blind:
            now.roll_settled_s, now.noise_s = 0.0, 0.0
        else:
            sense(tick, now, branches.x[now.best, V], PERIOD_S)
            now.effort_mps2 += EFFORT_SHARE * (tick.ax_mps2 - now.effort_mps2)
            if now.not_turned > PROOF:
                now.proven = 1
        stands = _follow(tick, rule, now, branches, blind, silent)
        if away or silent:
            forget_axes(now)
        elif watch_axes(tick, now, branches.x[now.best], PERIOD_S):
            _begin_again(now, branches, now.calm_d_m, now.calm_w_m)
        if now.tick % TRY_TICKS == 0:
            branch_out(branches, now, not stands and not blind and not silent, PERIOD_S)
            prune(branches, now)
        now.slip_share = slip_share(branches, now)
        if not silent:
            _supervise(now, branches)
    elif now.tick * PERIOD_S >= rule.latency_s + FIRST_WAIT_S:
        begin_branches(branches, now, tick.aligned_m, tick.aligned_m, tick.wheel_speed_mps)
    count = publish(tick, row, rule, now, branches, stands, blind, silent, out, events, count)
    now.tick += 1
    return count


@kernel
def _follow(tick: Record, rule: Record, now: Record, branches: Branches, blind: bool, silent: bool) -> bool:  # noqa: FBT001 - a kernel takes its arguments by place
    """Predict all accounts and show them what the wheel says; gives whether it stands."""
    z_m = tick.aligned_m
    variance = 0.0
    if silent:
        now.followed, now.still = 0, 0
    else:
        moved = abs(tick.way_m - now.before_m) > 0.5 * rule.pulse_m
        variance = rim_variance(z_m, tick.quantum_m, now, PERIOD_S)
        watch_rim(now, PERIOD_S)
        if now.gap_s > 0.0:
            bridge_gap(tick, now, branches, variance, PERIOD_S)
            now.gap_s = 0.0
        stands = watch_standstill(tick, moved, now, PERIOD_S) and not blind
    now.before_m = tick.way_m
    stands = not silent and stands
    noise = np.empty(5)
    noise[FORCE] = 0.0 if blind else max(now.quiet * now.force_var, LEAST_FORCE_MPS2**2)
    noise[CREEP] = now.creep_var
    noise[ACCELERATION] = BLIND_ACCELERATION if blind else 0.0
    ax_mps2, gx_radps, gy_radps, gz_radps = tick.ax_mps2, tick.gx_radps, tick.gy_radps, tick.gz_radps
    for i in range(now.branches):
        x, p, own = branches.x[i], branches.p[i], branches.about[i]
        noise[WALK] = own.walk
        noise[RATE] = BLIND_RATE_VAR if blind else _rate_noise(own, now)
        if blind:
            tick.ax_mps2 = GRAVITY_MPS2 * np.sin(x[TH]) + x[M] * tick.ay_mps2
            tick.gx_radps, tick.gy_radps, tick.gz_radps = now.roll_bias_radps, x[B], now.yaw_bias_radps
        predict(x, p, own.mode, PERIOD_S, tick, now, noise)
        if silent:
            continue
        residual_m = z_m - x[W]
        if own.mode == SLIPPING:
            own.loose_var = max(own.loose_var, p[V, V])
            _watch_walk(x, own, residual_m, variance, now)
        elif i == now.best and not blind:
            _watch_creep(p, own, residual_m, variance, now)
        if own.mode == SLIPPING and abs(x[V]) > BACKWARDS_MPS and x[V] * (x[W] - own.slip_w_m) < 0.0:
            own.log_weight -= BACKWARDS_LOG
        own.log_weight += correct(x, p, W, residual_m, variance) - own.first * PERIOD_S / FIRST_SLIP_S
        if stands:
            owned_m = _rest(x, p, tick, now)
            now.excess_m += owned_m * (i == now.best)
    tick.ax_mps2, tick.gx_radps, tick.gy_radps, tick.gz_radps = ax_mps2, gx_radps, gy_radps, gz_radps
    return stands


@kernel
def _rate_noise(own: Record, now: Record) -> float:
    """Variance of the pitch rate's mean over a tick that adds up over time."""
    quiet = max(now.quiet, LEAST_QUIET_SLIPPING) if own.mode == SLIPPING else now.quiet
    return float(max(quiet * now.rate_var, LEAST_RATE_RADPS**2))


@kernel
def _begin_again(now: Record, branches: Branches, way_m: float, rim_m: float) -> None:
    """The inertial sensor was not what it seemed: by the wheel since it was at `rim_m`, and the train at `way_m`.

    What that changes is owned.
    """
    now.proven = 0
    x = branches.x[now.best]
    d_m, w_m = way_m + x[W] - rim_m, x[W]
    now.excess_m += abs(x[D] - d_m)
    now.contested_m += abs(x[D] - d_m)
    begin_branches(branches, now, d_m, w_m, now.rim_mps)
    now.branches = 1


@kernel
def _supervise(now: Record, branches: Branches) -> None:
    """End a slip in which the rim has long run as a train does: wheel and inertial sensor contradict each other."""
    own, x = branches.about[now.best], branches.x[now.best]
    if now.distrust_s > 0.0 and (now.distrust_s > PERIOD_S or not now.broken):
        now.distrust_s -= PERIOD_S
        if now.distrust_s <= 0.0:
            now.distrust_s = 0.0
            begin_branches(branches, now, x[D], x[W], now.rim_mps)
            return
    tame_ticks = now.tick - max(own.slip_since, now.wild_tick)
    apart = abs(x[U]) > min(APART_MPS, APART_SIGMA * np.sqrt(branches.p[now.best, U, U]))
    if own.mode == SLIPPING and apart and tame_ticks * PERIOD_S > LONGEST_TAME_S and abs(now.rim_mps) > TURNING_MPS:
        now.distrust_s = DISTRUST_S
        _begin_again(now, branches, own.slip_d_m, own.slip_w_m)


@kernel
def _watch_walk(x: Floats, own: Record, residual_m: float, variance: float, now: Record) -> None:
    """The slip speed's random walk follows what it has just done (as in GARCH models)."""
    shown = max(residual_m * residual_m - 4.0 * variance, 0.0) / PERIOD_S**3
    if own.top_mps < SHOWN_MPS <= abs(x[U]):
        own.log_weight += against_effort(x[U], own.effort_mps2)
    suspected = own.top_mps < PLAIN_SLIP_MPS + 2.0 * np.sqrt(now.creep_var)
    least = (LEAST_WALK if suspected else PLAIN_WALK) ** 2 + 2.0 * now.creep_var
    own.walk = max(least, own.walk + WALK_SHARE * (min(shown, MOST_WALK**2) - own.walk))
    own.top_mps = max(own.top_mps, abs(x[U]))


@kernel
def _watch_creep(p: Floats, own: Record, residual_m: float, variance: float, now: Record) -> None:
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


@kernel
def _rest(x: Floats, p: Floats, tick: Record, now: Record) -> float:
    """Speed and pitch rate are nought at rest: speed, bias and attitude are reset; gives what is to be owned [m].

    Not for an account of a train that slides on over wheels that stand.
    """
    if abs(x[V]) >= min(STILL_MPS + 3.0 * np.sqrt(p[V, V]), MOST_STILL_MPS):
        return 0.0
    before_m = x[D]
    correct(x, p, V, -x[V], REST_SPEED_SIGMA_MPS**2)
    lacking = tick.gy_radps - (tick.gz_radps - now.yaw_bias_radps) * now.roll_rad
    correct(x, p, B, lacking - x[B], 4.0 * max(now.rate_var, 0.25 * REST_RATE_SIGMA_RADPS**2))
    return float(max(0.0, abs(x[D] - before_m) - RESTING_M))
