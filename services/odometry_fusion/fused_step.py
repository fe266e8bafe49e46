"""One tick of the fused mode after the other."""

from __future__ import annotations

from typing import Final

import numpy as np

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_branch import ACCELERATION, CREEP, FORCE, RATE, WALK, correct, predict, steady_force
from services.odometry_fusion.fused_gaps import bridge_gap, watch_gap
from services.odometry_fusion.fused_hypotheses import TRY_TICKS, branch_out, prune, slip_share
from services.odometry_fusion.fused_layout import SLIPPING, TH, B, Branches, D, Record, V, W
from services.odometry_fusion.fused_noise import force_noise, rate_noise, watch_creep, watch_walk
from services.odometry_fusion.fused_origin import FIRST_SLIP_S, begin_again, begin_branches
from services.odometry_fusion.fused_output import publish
from services.odometry_fusion.fused_rim import watch_rim
from services.odometry_fusion.fused_supervision import supervise
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
BLIND_ACCELERATION: Final = 0.25
"""Intensity [m²/s³] of an acceleration that is not measured: 0.5 m/s per √s."""
BLIND_RATE_VAR: Final = 9e-6 / PERIOD_S
"""Of a pitch that is not followed: gradients change by 3 per mille per √s."""
EFFORT_SHARE: Final = 0.2
"""Of the newest in the effort."""
PROOF: Final = 1.0
"""Evidence for x looking forward, (m/s²)² s, before what it shows counts as effort."""
BACKWARDS_MPS: Final = 1.0
BACKWARDS_LOG: Final = 0.5
"""No train runs backwards while its wheels turn forwards: what an account of that loses per tick."""
STILL_MPS: Final = 0.5
MOST_STILL_MPS: Final = 2.0
"""A standing wheel stands for a standing train if the account's speed is below these (and three sigma)."""
REST_SPEED_SIGMA_MPS: Final = 0.05
REST_RATE_SIGMA_RADPS: Final = 1e-3
RESTING_M: Final = 0.005
"""What a tick at rest changes of the way beyond this is owned: no wheel tells it."""
RESTING_LOG: Final = 0.5
"""A wheel that stands under a train that stands adheres: what an account of a slip loses per tick."""


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
            sense(tick, now, branches.x[now.best, V], branches.x[now.best, TH], PERIOD_S)
            now.effort_mps2 += EFFORT_SHARE * (tick.ax_mps2 - now.effort_mps2)
            if now.not_turned > PROOF:
                now.proven = 1
        stands = _follow(tick, rule, now, branches, blind, silent)
        if away or silent:
            forget_axes(now)
        elif watch_axes(tick, now, branches.x[now.best], PERIOD_S):
            begin_again(now, branches, now.calm_d_m, now.calm_w_m)
        if now.tick % TRY_TICKS == 0:
            branch_out(branches, now, not stands and not blind and not silent, PERIOD_S)
            prune(branches, now)
        now.slip_share = slip_share(branches, now)
        if not silent:
            supervise(now, branches)
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
        variance = rim_variance(z_m, tick.quantum_m, now, PERIOD_S)
        watch_rim(now, PERIOD_S)
        if now.gap_s > 0.0:
            bridge_gap(tick, now, branches, variance, PERIOD_S)
            now.gap_s = 0.0
        stands = watch_standstill(tick, rule.pulse_m, now, PERIOD_S) and not blind
    stands = not silent and stands
    noise = np.empty(5)
    noise[FORCE] = 0.0 if blind else force_noise(now)
    noise[CREEP] = now.creep_var
    noise[ACCELERATION] = BLIND_ACCELERATION if blind else 0.0
    ax_mps2, gx_radps, gy_radps, gz_radps = tick.ax_mps2, tick.gx_radps, tick.gy_radps, tick.gz_radps
    for i in range(now.branches):
        x, p, own = branches.x[i], branches.p[i], branches.about[i]
        noise[WALK] = own.walk
        noise[RATE] = BLIND_RATE_VAR if blind else rate_noise(own, now)
        if blind:
            tick.ax_mps2 = steady_force(x, tick)
            tick.gx_radps, tick.gy_radps, tick.gz_radps = now.roll_bias_radps, x[B], now.yaw_bias_radps
        predict(x, p, own.mode, PERIOD_S, tick, now, noise)
        if silent:
            continue
        residual_m = z_m - x[W]
        if own.mode == SLIPPING:
            own.loose_var = max(own.loose_var, p[V, V])
            watch_walk(x, p, own, residual_m, variance, now)
        elif i == now.best and not blind:
            watch_creep(p, own, residual_m, variance, now)
        if own.mode == SLIPPING and abs(x[V]) > BACKWARDS_MPS and x[V] * (x[W] - own.slip_w_m) < 0.0:
            own.log_weight -= BACKWARDS_LOG
        own.log_weight += correct(x, p, W, residual_m, variance) - own.first * PERIOD_S / FIRST_SLIP_S
        if stands:
            owned_m = rest(x, p, own, tick, now)
            now.excess_m += owned_m * (i == now.best)
    tick.ax_mps2, tick.gx_radps, tick.gy_radps, tick.gz_radps = ax_mps2, gx_radps, gy_radps, gz_radps
    return stands


@kernel
def rest(x: Floats, p: Floats, own: Record, tick: Record, now: Record) -> float:
    """Speed and pitch rate are nought at rest: speed, bias and attitude are reset; gives what is to be owned [m].

    Not for an account of a train that slides on over wheels that stand.
    """
    if abs(x[V]) >= min(STILL_MPS + 3.0 * np.sqrt(p[V, V]), MOST_STILL_MPS):
        return 0.0
    if own.mode == SLIPPING:
        own.log_weight -= RESTING_LOG
    before_m = x[D]
    correct(x, p, V, -x[V], REST_SPEED_SIGMA_MPS**2)
    lacking = tick.gy_radps - (tick.gz_radps - now.yaw_bias_radps) * now.roll_rad
    correct(x, p, B, lacking - x[B], 4.0 * max(now.rate_var, 0.25 * REST_RATE_SIGMA_RADPS**2))
    return float(max(0.0, abs(x[D] - before_m) - RESTING_M))
