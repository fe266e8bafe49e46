"""What the fused mode publishes of a tick: row, bound, status, and where slips begin and end."""

from __future__ import annotations

from typing import Final

import numpy as np

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_bound import (
    allowed,
    contested,
    lost_way,
    own_up,
    provisional,
    settle,
    unconfirmed,
    unseen,
)
from services.odometry_fusion.fused_branch import acceleration
from services.odometry_fusion.fused_gaps import hidden_by_lateness
from services.odometry_fusion.fused_layout import (
    BEGAN,
    BEYOND,
    CONTRADICTED,
    ENDED,
    FINE,
    IN_SLIP,
    LATE,
    NO_IMU,
    NO_PULSES,
    NO_SENSOR,
    NOT_FOUND,
    OVERDUE,
    SLIPPING,
    TH,
    TURNED,
    UNCONFIRMED,
    B,
    Branches,
    D,
    Record,
    U,
    V,
    W,
)
from services.odometry_fusion.fused_turn import watch_turns
from services.odometry_fusion.motion_log import DEGRADED, LOST, PERIOD_S, VALID
from services.odometry_fusion.tick_layout import Records

SLIP_SHARE: Final = 0.9
"""A slip is published when it is so probable, and has come to"""
SLIP_MPS: Final = 0.32
"""this slip speed (and twice the micro-slip) or"""
SLIP_M: Final = 0.7
"""this much way: micro-slips are followed, but not called slips."""
ADHERES_SHARE: Final = 0.3
"""Re-adhesion is published when a slip is less probable."""
HOLD_TICKS: Final = 25
"""for so long without a break: wheels that cycle are one slip."""
MACRO_SHARE: Final = 0.018
"""A rim that is off by less of the speed creeps, and does not slip: adhesion is exceeded at 1 to 2 %."""
LATE_TICKS: Final = 30
"""A slip that is only found when it has just ended is published all the same, for HOLD_TICKS."""
DOUBTFUL: Final = 1.75
"""What is open may come to so many times what ETCS allows for before the status is degraded, and the bound as it is."""
FIRST_MPS: Final = 0.5
FIRST_SHARE: Final = 0.8
FIRST_SLIP_M: Final = 3.0
"""Before the first account is at hand a turning wheel may slip by so much in a second."""
CONTESTED_SHARE: Final = 0.6
"""Nor may wheel and inertial sensor be apart by more than this share of it without either being believed."""
CALM_SHARE: Final = 0.05
SMOOTHING: Final = 0.3
"""Share of the newest in the acceleration that is held over the latency."""
LONGEST_HELD_S: Final = 0.5
"""A longer latency is bridged by the wheel while it adheres."""
PLAIN_M: Final = 0.05
"""Pulses in a speed: its bound's least part [m/s]."""


@kernel
def publish(
    tick: Record,
    row: int,
    rule: Record,
    now: Record,
    branches: Branches,
    stands: bool,  # noqa: FBT001 - a kernel takes its arguments by place
    blind: bool,  # noqa: FBT001 - the same
    silent: bool,  # noqa: FBT001 - the same
    out: Record,
    events: Records,
    count: int,
) -> int:
    """Fill a row; gives the number of events, those of this row included."""
    if now.branches == 0:
        now.distance_m = tick.way_m
        now.way_m += abs(tick.way_m - now.live_d_m)
        now.live_d_m = tick.way_m
        out.speed_mps, out.sensed_distance_m = tick.wheel_speed_mps, tick.aligned_m
        out.speed_bound_mps = abs(tick.wheel_speed_mps) + 1.0
        moves = abs(tick.wheel_speed_mps) > FIRST_MPS
        first_m = FIRST_SHARE * abs(tick.wheel_speed_mps) + FIRST_SLIP_M if moves else 0.0
        _bound(rule, now, first_m, first_m, UNCONFIRMED if moves else FINE, DEGRADED if moves else VALID, out)
        return count
    watch_turns(tick, now, branches, blind or silent, PERIOD_S)
    _calm(now, blind, silent)
    settle(branches, now)
    own_up(branches, now, PERIOD_S)
    count = _episodes(row, rule, now, branches, events, count)
    _motion(tick, rule, now, branches, stands, silent, out)
    if blind and not stands:
        unseen_m = unseen(now, out.speed_mps, PERIOD_S)
        now.excess_m += unseen_m
        now.contested_m += unseen_m
    elif not blind:
        now.gap_m = 0.0
    contested_m = now.scale * (contested(branches, now, PERIOD_S) + hidden_by_lateness(now, branches.x[now.best, V]))
    unconfirmed_m = now.scale * unconfirmed(branches, now)
    reason, status = _judge(now, blind, silent, unconfirmed_m > 0.0)
    contested_m = max(contested_m, unconfirmed_m)
    provisional_m = max(contested_m, now.scale * provisional(branches, now))
    now.vouched_m = provisional_m
    _bound(rule, now, provisional_m, contested_m, reason, status, out)
    return count


@kernel
def _judge(now: Record, blind: bool, silent: bool, doubted: bool) -> tuple[int, int]:  # noqa: FBT001 - a kernel takes its arguments by place
    """Reason and status, but for what the bound says."""
    if silent:
        return (NO_SENSOR, LOST) if blind else (NO_PULSES, DEGRADED)
    slides = blind and now.broken > 0
    for holds, reason in (
        (now.turned > 0, TURNED),
        (now.distrust_s > 0.0, CONTRADICTED),
        (blind, NO_IMU),
        (now.late_s > 0.0, LATE),
        (now.slip != 0 and now.overdue > 0, OVERDUE),
        (doubted, UNCONFIRMED),
    ):
        if holds:
            return reason, LOST if slides else DEGRADED
    return (FINE if now.slip == 0 else IN_SLIP), VALID


@kernel
def _calm(now: Record, blind: bool, silent: bool) -> None:  # noqa: FBT001 - a kernel takes its arguments by place
    """Count the ticks for which nothing has been in doubt."""
    if now.slip != 0 or blind or silent:
        now.calm, now.unsettled = 0, 1
    elif now.slip_share > CALM_SHARE:
        now.calm = 0
    else:
        now.calm += 1


@kernel
def _episodes(row: int, rule: Record, now: Record, branches: Branches, events: Records, count: int) -> int:
    """Whether the wheels slip, as published; gives the number of events."""
    x, own = branches.x[now.best], branches.about[now.best]
    _weigh_slip(now, branches)
    if now.slip == 0:
        just_ended = own.mode != SLIPPING and now.tick - own.since <= LATE_TICKS
        sure = now.slip_share < 1.0 - SLIP_SHARE if just_ended else own.mode == SLIPPING and now.slip_share > SLIP_SHARE
        if sure and now.slip_top > 1.0 and own.slip_since > now.slip_ended:
            now.slip = 1 if x[W] - own.slip_w_m > x[D] - own.slip_d_m else -1
            now.slip_tick, now.overdue, now.hold = own.slip_since, 0, HOLD_TICKS
            now.episode += 1
            count = _note(row, BEGAN, now, branches, events, count)
        return count
    now.hold = HOLD_TICKS if now.slip_share >= ADHERES_SHARE else now.hold - 1
    if now.hold <= 0:
        count = _note(row, ENDED, now, branches, events, count)
        now.slip, now.overdue, now.slip_ended = 0, 0, own.slip_since
    elif not now.overdue and (now.tick - now.slip_tick) * PERIOD_S > rule.longest_slip_s:
        now.overdue = 1
        count = _note(row, NOT_FOUND, now, branches, events, count)
    return count


@kernel
def _weigh_slip(now: Record, branches: Branches) -> None:
    """How much the believed account's latest slip has come to, as a share of what is published, into `now.slip_top`."""
    x, own = branches.x[now.best], branches.about[now.best]
    if own.slip_since != now.slip_since:
        now.slip_since, now.slip_top = own.slip_since, 0.0
    lost_m = abs(lost_way(branches, now))
    if own.mode == SLIPPING:
        if abs(x[U]) > MACRO_SHARE * abs(x[V]):
            slip_mps = SLIP_MPS + 2.0 * np.sqrt(now.creep_var)
            now.slip_top = max(now.slip_top, abs(x[U]) / slip_mps, lost_m / SLIP_M)
    elif own.since > own.slip_since and now.tick - own.since <= LATE_TICKS and not own.free:
        mean_mps = lost_m / ((own.since - own.slip_since) * PERIOD_S)
        if mean_mps > MACRO_SHARE * abs(x[V]):
            now.slip_top = max(now.slip_top, lost_m / SLIP_M)


@kernel
def _note(row: int, phase: int, now: Record, branches: Branches, events: Records, count: int) -> int:
    """One event more, where there is room for it."""
    if count < len(events):
        event = events[count]
        event.row, event.phase, event.episode, event.slip = row, phase, now.episode - 1, now.slip
        event.correction_s = (now.tick - now.slip_tick) * PERIOD_S
        event.corrected_m = lost_way(branches, now) * now.scale
        event.bound_m = provisional(branches, now) * now.scale
    return min(count + 1, len(events))


@kernel
def _motion(
    tick: Record,
    rule: Record,
    now: Record,
    branches: Branches,
    stands: bool,  # noqa: FBT001 - a kernel takes its arguments by place
    silent: bool,  # noqa: FBT001 - the same
    out: Record,
) -> None:
    """Distance and speed brought from the instant that the inertial sample shows to now."""
    x, p = branches.x[now.best], branches.p[now.best]
    if tick.imu_missing_s <= LONGEST_HELD_S:
        now.acceleration_mps2 += SMOOTHING * (acceleration(x, tick) - now.acceleration_mps2)
    else:
        now.acceleration_mps2 = 0.0
    held_s = rule.latency_s
    d_m = x[D] + x[V] * held_s + 0.5 * now.acceleration_mps2 * held_s * held_s
    speed_mps = x[V] + now.acceleration_mps2 * held_s
    if held_s > LONGEST_HELD_S and now.slip == 0 and not silent:
        d_m, speed_mps = x[D] + tick.way_m - tick.aligned_m, tick.wheel_speed_mps
    if stands and now.slip == 0:
        d_m, speed_mps = x[D], 0.0
    now.live_d_m = d_m
    now.distance_m = now.scale * (d_m - now.origin_d_m) + now.origin_m
    now.way_m += now.scale * abs(speed_mps) * PERIOD_S
    if stands and now.slip == 0:
        now.since_rest_s = 0.0
    out.speed_mps = now.scale * speed_mps
    out.speed_bound_mps = PLAIN_M + rule.share * abs(out.speed_mps) + 3.0 * np.sqrt(max(p[V, V], 0.0))
    out.acceleration_mps2 = now.scale * now.acceleration_mps2
    out.slip, out.standstill = now.slip, 1 if stands and now.slip == 0 else 0
    out.yaw_radps = tick.gz_radps - now.yaw_bias_radps
    out.sensed_distance_m = now.scale * (x[D] - now.origin_d_m) + now.origin_m
    out.gradient_permille = 1000.0 * np.tan(min(max(x[TH], -0.3), 0.3))
    out.gyro_bias_radps = x[B]
    out.since_rest_s = now.since_rest_s


@kernel
def _bound(
    rule: Record, now: Record, provisional_m: float, contested_m: float, reason: int, status: int, out: Record
) -> None:
    """Bound, never above what ETCS allows while all is well; else as large as it must be, and beyond that much lost."""
    most_m = allowed(now.way_m, now.distance_m)
    known_m = rule.start_bound_m + rule.share * now.way_m + now.owed_m + now.excess_m
    bound_m = known_m + provisional_m
    if status == VALID and (
        provisional_m > DOUBTFUL * most_m or contested_m + now.contested_m > CONTESTED_SHARE * most_m
    ):
        status, reason = DEGRADED, BEYOND
    elif status == VALID:
        # The parts are cautious one by one and their sum more so: errors stay below (docs/odometry_fusion.md).
        bound_m = min(bound_m, most_m)
    elif provisional_m > most_m and reason in (NO_IMU, NO_PULSES):
        reason, status = BEYOND, LOST
    out.distance_m, out.way_m = now.distance_m, now.way_m
    out.bound_m, out.excess_m, out.provisional_m = bound_m, now.excess_m, provisional_m
    out.wheel_scale = now.scale if now.scale_sigma > 0.0 else np.nan
    out.reason, out.status = reason, status
