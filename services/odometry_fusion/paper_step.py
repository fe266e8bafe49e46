"""One tick of the paper's method after the other: wheel while it adheres, inertial sensor while it slips."""

from __future__ import annotations

import math

from services.numerics.kernel import kernel
from services.odometry_fusion.motion_log import DEGRADED, LOST, PERIOD_S, VALID
from services.odometry_fusion.paper_begin import beginning_error, watch_beginning
from services.odometry_fusion.paper_detection import accelerations_differ
from services.odometry_fusion.paper_episode import (
    BEGAN,
    ENDED,
    NO_END,
    begin_episode,
    end_episode,
    follow_ended,
    give_up,
    is_overdue,
    overrun,
    resume_wheel,
    spread,
    step_episode,
)
from services.odometry_fusion.paper_error import distance_error
from services.odometry_fusion.paper_layout import (
    ADHERING,
    FRESH,
    JITTERING,
    NO_IMU,
    NO_PULSES,
    NO_SENSOR,
    NOT_FOUND,
    OVERDUE,
    TOO_MUCH,
    WAS_NOT_FOUND,
    WRONG_AXES,
    Record,
)
from services.odometry_fusion.paper_mounting import watch_mounting
from services.odometry_fusion.paper_rest import departs_unseen, watch_rest
from services.odometry_fusion.paper_smoothing import LONGEST_HOLD_S, counts_missing, smooth
from services.odometry_fusion.paper_stamps import watch_stamps, widen
from services.odometry_fusion.paper_track import FASTEST_MPS, present
from services.odometry_fusion.paper_witness import FACTOR, compare_wheel, dismiss, doubt_start, fade_wheel
from services.odometry_fusion.tick_layout import Records

HARDEST_MPS2 = 1.4
"""No train speeds up or brakes harder in service."""
SLIP_MPS2 = 0.7
"""An unseen slip grows about so fast, up to"""
SLIP_M = 20.0
"""what a slip costs at worst in nine of ten cases."""
USUAL_SLIP_S = 12.0
"""Nine of ten slips are over by then (Iwata et al., section 3.1.4: 10 s; and the windows' delay)."""
LEFT_SHARE = 0.75
"""What ended corrections have left adds up in the bound, and cancels out in part in the error."""
LATEST_JERK_MPS3 = 1.0
"""By so much the acceleration may change while the sensor's latency passes."""


@kernel
def run_ticks(
    ticks: Records,
    smoothed: Records,
    first: int,
    rules: Records,
    state: Records,
    tracks: Records,
    witnesses: Records,
    out: Records,
    events: Records,
) -> int:
    """Rows for ticks from `first` on, earlier ones being history; gives the number of events."""
    count = 0
    in_force = rules.copy()
    for at in range(first, len(ticks)):
        watch_stamps(ticks, at, rules[0].pulse_m, state[0].mode == ADHERING, state)
        state[0].jittering = 1 if widen(rules, state, ticks[at].wheel_speed_mps, in_force) else 0
        smooth(ticks, at, rules, smoothed)
        count = _step(ticks, smoothed, at, at - first, in_force, state, tracks, witnesses, out, events, count)
    return count


@kernel
def _note(
    events: Records, count: int, row: int, phase: int, state: Records, tracks: Records, corrected_m: float, m: float
) -> int:
    """One event more, where there is room for it."""
    if count < len(events):
        event, now = events[count], state[0]
        event.row, event.phase, event.episode, event.slip = row, phase, now.episode, now.slip
        event.start_ns, event.correction_s = tracks[0].start_ns, tracks[0].t_s
        event.corrected_m, event.bound_m = corrected_m, m
    return min(count + 1, len(events))


@kernel
def _step(
    ticks: Records,
    smoothed: Records,
    at: int,
    row: int,
    rules: Records,
    state: Records,
    tracks: Records,
    witnesses: Records,
    out: Records,
    events: Records,
    count: int,
) -> int:
    now, tick, rule = state[0], ticks[at], rules[0]
    wrong_axes = watch_mounting(ticks, at, state)
    no_imu = tick.imu_missing_s > LONGEST_HOLD_S or wrong_axes
    no_pulses = counts_missing(tick, rule.pulse_m)
    now.excess_m += tick.doubt_m
    stands = False
    if now.mode == ADHERING:
        stands = watch_rest(ticks, at, no_pulses, state)
        if stands:
            now.distrusted = 0
            dismiss(state, witnesses)
        follow_ended(smoothed, at, rules, state, tracks)
        if stands:
            fade_wheel(state)
        else:
            compare_wheel(ticks, smoothed, at, rules, state, tracks, witnesses)
        _watch_gap(tick.way_m, no_imu, state)
        now.forced = 1 if no_pulses else 0
        differ = (
            smoothed[at].ready != 0
            and smoothed[at].wheel_ready != 0
            and accelerations_differ(smoothed[at].matched_mps2, smoothed[at].wheel_mps2, rule.detection_mps2)
        )
        fresh = watch_beginning(ticks, smoothed, at, differ, state, witnesses) and now.begun != 0
        slips = differ or (smoothed[at].ready != 0 and departs_unseen(smoothed[at].ax_mps2, state))
        starts = (slips and not fresh) or no_pulses
        judged, unconfirmed = differ and not no_pulses, now.reopenable > 0
        if starts and not no_imu and begin_episode(ticks, smoothed, at, judged, rules, state, tracks):
            undone_m = tracks[0].distance_m - now.start_offset_m - smoothed[at].way_m
            doubt_start(undone_m, unconfirmed, rule.undetected_m, state)
            m = distance_error(rules, tracks[0].t_s, now.since_rest_s)
            count = _note(events, count, row, BEGAN, state, tracks, 0.0, m)
    else:
        dismiss(state, witnesses)
        count = _correct(ticks, smoothed, at, row, rules, state, tracks, events, count, no_imu)
    _write(ticks, smoothed, at, rules, state, tracks, out, row, stands, no_imu, no_pulses)
    if wrong_axes and out[row].status == DEGRADED:
        out[row].reason = WRONG_AXES
    return count


@kernel
def _correct(
    ticks: Records,
    smoothed: Records,
    at: int,
    row: int,
    rules: Records,
    state: Records,
    tracks: Records,
    events: Records,
    count: int,
    no_imu: int,
) -> int:
    """One tick within an episode."""
    now = state[0]
    now.since_rest_s += PERIOD_S
    former_m, slip = now.start_offset_m, now.slip
    chosen = step_episode(ticks, smoothed, at, rules, state, tracks)
    phase, bound_m = ENDED, -1.0
    if no_imu:
        bound_m = give_up(ticks, at, state, tracks, rules, now.wrong_axes)
        phase = NO_END
    elif chosen >= 0:
        if chosen > 0:
            _swap(tracks, chosen)
        bound_m = end_episode(ticks, smoothed, at, 0, rules, state, tracks)
    elif is_overdue(rules, state, tracks):
        overrun(state)
        m = distance_error(rules, tracks[0].t_s, now.since_rest_s)
        count = _note(events, count, row, NO_END, state, tracks, math.nan, m)
    elif now.mode == OVERDUE:
        bound_m = resume_wheel(ticks, smoothed, at, rules, state, tracks)
    if bound_m >= 0.0:
        # An end that was taken back has left its share already.
        now.excess_m += max(0.0, bound_m - now.closed_m) + now.unseen_m
        now.closed_m, now.unseen_m = max(bound_m, now.closed_m), 0.0
        count = _note(events, count, row, phase, state, tracks, now.offset_m - former_m, bound_m)
        if count > 0:
            events[count - 1].slip = slip
    return count


@kernel
def _swap(tracks: Records, chosen: int) -> None:
    """Put the chosen track first."""
    spare = tracks[0:1].copy()
    tracks[0] = tracks[chosen]
    tracks[chosen] = spare[0]


@kernel
def _watch_gap(way_m: float, no_imu: int, state: Records) -> None:
    """Keep count of time and way without the inertial sensor; what a slip may have cost then stays for good."""
    now = state[0]
    if no_imu:
        if now.gap_s == 0.0:
            now.gap_way_m = way_m
        now.gap_s += PERIOD_S
    elif now.gap_s > 0.0:
        now.excess_m += _unseen(now.gap_s, abs(way_m - now.gap_way_m))
        now.gap_s = 0.0


@kernel
def _unseen(gap_s: float, way_m: float) -> float:
    """What slips that nobody saw may have cost: one grows from nothing; more of them, the longer the way."""
    return min(0.5 * SLIP_MPS2 * gap_s * gap_s, SLIP_M + 0.03 * way_m)


@kernel
def _write(
    ticks: Records,
    smoothed: Records,
    at: int,
    rules: Records,
    state: Records,
    tracks: Records,
    out: Records,
    row: int,
    stands: int,
    no_imu: int,
    no_pulses: int,
) -> None:
    """The row: distance and speed at the tick itself, whatever the sensors' delays."""
    now, tick, rule, own = state[0], ticks[at], rules[0], out[row]
    error_mps = rule.share * abs(tick.wheel_speed_mps) + 0.3
    provisional_m = rule.undetected_m
    unproven = now.proven == 0 and now.proof_s >= 0.0
    if now.mode == ADHERING:
        own.distance_m, own.speed_mps = tick.way_m + now.offset_m, tick.wheel_speed_mps
        own.acceleration_mps2 = smoothed[at].wheel_mps2 if smoothed[at].ready else math.nan
        own.gradient_permille = math.nan
        if smoothed[at].ready:
            own.gradient_permille = 1e3 / 9.80665 * (smoothed[at].ax_mps2 - smoothed[at].wheel_mps2)
        provisional_m += now.apart_m + beginning_error(state)
        if now.gap_s > 0.0:
            provisional_m += _unseen(now.gap_s, abs(tick.way_m - now.gap_way_m))
            error_mps += SLIP_MPS2 * min(now.gap_s, 10.0)
        if no_pulses:
            silent_s = tick.tacho_missing_s
            provisional_m += 0.5 * HARDEST_MPS2 * silent_s * silent_s
            error_mps += HARDEST_MPS2 * silent_s
    else:
        lead_s = rule.latency_s
        distance_m, speed_mps, latest_mps2 = present(tracks[0:1], ticks, at, rule.window)
        own.distance_m = distance_m + speed_mps * lead_s + 0.5 * latest_mps2 * lead_s * lead_s
        own.speed_mps, own.acceleration_mps2 = speed_mps + latest_mps2 * lead_s, latest_mps2
        own.gradient_permille = 1e3 * math.sin(tracks[0].pitch_rad)
        provisional_m += min(distance_error(rules, tracks[0].t_s, now.since_rest_s), FASTEST_MPS * tracks[0].t_s)
        provisional_m += LATEST_JERK_MPS3 * lead_s**3 + now.unseen_m
        above_m, below_m = spread(state, tracks)
        own.distance_m += 0.5 * (above_m - below_m)
        provisional_m += 0.5 * FACTOR * (above_m + below_m)
        # The longer a correction lasts, the likelier the wheel has adhered again unnoticed.
        wheel_m = tick.way_m + now.start_offset_m
        doubt = min(1.0, max(0.0, (tracks[0].t_s - USUAL_SLIP_S) / USUAL_SLIP_S))
        # Until the first departure has shown that the axes are right, nothing speaks for the inertial sensor either,
        # nor for a start point that witnesses contradict.
        provisional_m += (1.0 if unproven or now.suspect else doubt) * abs(own.distance_m - wheel_m)
        error_mps = 0.3 + 2.0 * distance_error(rules, tracks[0].t_s, now.since_rest_s) / max(tracks[0].t_s, 1.0)
        error_mps = min(error_mps, FASTEST_MPS)
    if stands:
        own.speed_mps, error_mps = 0.0, 0.05
    now.run_m = max(now.run_m + abs(own.speed_mps) * PERIOD_S, abs(own.distance_m))
    own.run_m, own.speed_bound_mps = now.run_m, error_mps
    own.excess_m, own.provisional_m = now.excess_m, provisional_m
    own.slip = 0 if now.mode == ADHERING else now.slip
    own.standstill = 1 if stands else 0
    own.gyro_bias_radps = now.pitch_bias_radps
    own.since_rest_s = now.since_rest_s
    own.yaw_radps = tick.gz_radps - now.yaw_bias_radps
    own.sensed_m = own.distance_m - (tick.way_m - tick.aligned_m)
    own.status, own.reason = _status(now, no_imu, no_pulses)
    own.bound_m = rule.share * now.run_m + now.excess_m + provisional_m
    _limit(rule, own, now.mode == ADHERING or not unproven)


@kernel
def _limit(rule: Record, own: Record, proven: bool) -> None:  # noqa: FBT001 - a kernel takes its arguments by place
    """Not above what ETCS allows while the status is valid, which it is not once slips may have cost more than that."""
    if own.status == VALID and proven:
        most_m = rule.cap_m + rule.cap_share * abs(own.distance_m)
        if own.provisional_m + LEFT_SHARE * own.excess_m > most_m:
            own.status, own.reason = DEGRADED, TOO_MUCH
        else:
            own.bound_m = min(own.bound_m, most_m)


@kernel
def _status(now: Record, no_imu: int, no_pulses: int) -> tuple[int, int]:
    if no_imu and no_pulses:
        return LOST, NO_SENSOR
    reason = 0
    if now.mode == OVERDUE:
        reason = NOT_FOUND
    elif no_pulses:
        reason = NO_PULSES
    elif no_imu:
        reason = NO_IMU
    elif now.distrusted:
        reason = WAS_NOT_FOUND
    elif now.begun != 0 and now.fresh_s >= 0.0:
        reason = FRESH
    elif now.jittering:
        reason = JITTERING
    return DEGRADED if reason else VALID, reason
