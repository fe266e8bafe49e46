"""Course of a correction: begun where the wheel slips, followed from its start points, ended by re-adhesion."""

from __future__ import annotations

from services.numerics.kernel import kernel
from services.odometry_fusion.motion_log import PERIOD_S
from services.odometry_fusion.paper_attitude import forward_acceleration
from services.odometry_fusion.paper_error import closed_error, distance_error
from services.odometry_fusion.paper_layout import ADHERING, CORRECTING, OVERDUE
from services.odometry_fusion.paper_readhesion import adheres_again
from services.odometry_fusion.paper_start_point import least_jerk, start_point
from services.odometry_fusion.paper_track import begin_track, present, step_track
from services.odometry_fusion.tick_layout import Records

BEGAN, ENDED, NO_END = 0, 1, 2
RESUME_TICKS = 30
"""After a correction that found no end, the wheel is taken up again once accelerations have agreed for so long."""
STUCK_MPS = 3.0
"""A counter at a standstill is not believed while the inertial speed is above this."""
REOPENED_SHARE = 0.8
"""Older tracks than this share of the longest correction are not taken up again."""
UNCONFIRMED_NS = 8_000_000_000
"""An end after which nothing has slipped for so long was one: both windows have passed, and wheels cycle faster."""
CLOSING_SHARE = 0.6
"""Share of (drift of speed × time) that is drift of distance: ½ by a wrong pitch, 1 by a wrong initial speed."""


@kernel
def _follow(
    ticks: Records, smoothed: Records, at: int, start: int, rules: Records, state: Records, tracks: Records
) -> None:
    """One more track from `start`, brought up to `at`."""
    now = state[0]
    own = tracks[now.tracks : now.tracks + 1]
    begin_track(own, smoothed, start, ticks[start].t_ns, now.offset_m, state)
    for k in range(start + 1, at + 1):
        step_track(own, smoothed, k, rules[0].correction, state)
    now.tracks += 1


@kernel
def begin_episode(
    ticks: Records,
    smoothed: Records,
    at: int,
    judged: bool,  # noqa: FBT001 - a kernel takes its arguments by place
    rules: Records,
    state: Records,
    tracks: Records,
) -> bool:
    """Choose start points and follow them; False where no tick could serve as one, or `judged` they show no slip.

    Soon after the last episode there is no start point yet: its end is taken back, and its tracks go on.
    """
    now, rule = state[0], rules[0]
    young = tracks[0].t_s < REOPENED_SHARE * rule.longest_s
    if now.reopenable > 0 and young and is_unconfirmed(ticks, at, state):
        if judged and not _shows_slip(smoothed, at, now.reopenable, rules, tracks):
            return False
        _reopen(state)
        return True
    now.tracks = 0
    latest = max(0, at - rule.look_back)
    earliest = max(0, latest - rule.search)
    while earliest < latest and ticks[earliest].t_ns <= now.ended_ns:
        earliest += 1
    point = start_point(smoothed, latest, earliest, rules)
    if point < 0:
        point = least_jerk(smoothed, latest, earliest, rules)
    if point < 0:
        point = least_jerk(smoothed, at - 1, earliest, rules)
    if point < 0:
        return False
    while point >= 0 and now.tracks < rule.start_points:
        _follow(ticks, smoothed, at, point, rules, state, tracks)
        point = start_point(smoothed, point - rule.spacing, earliest, rules)
    if judged and not _shows_slip(smoothed, at, now.tracks, rules, tracks):
        now.tracks = now.reopenable = 0
        return False
    now.mode = CORRECTING
    now.closed_m = 0.0
    now.episode += 1
    now.agreeing = 0
    now.start_offset_m = now.offset_m
    difference_mps = smoothed[at].wheel_mps2 - tracks[0].forward_mps2
    now.slip = 0 if now.forced else (1 if difference_mps > 0.0 else -1)
    return True


@kernel
def is_unconfirmed(ticks: Records, at: int, state: Records) -> bool:
    """Whether the last end is so young that nothing has confirmed it."""
    return bool(ticks[at].t_ns - state[0].ended_ns < UNCONFIRMED_NS)


@kernel
def _shows_slip(smoothed: Records, at: int, count: int, rules: Records, tracks: Records) -> bool:
    """Whether a track finds the wheel's acceleration wrong by Ta less the gradient, which equation (2) has taken off.

    If none does, the line has become steeper than Ta expects, as the gyro has seen, or the sensor is off.
    """
    for k in range(count):
        forward_mps2 = forward_acceleration(smoothed[at].matched_mps2, tracks[k].pitch_rad)
        if abs(forward_mps2 - smoothed[at].wheel_mps2) > rules[0].headroom_mps2:
            return True
    return False


@kernel
def _reopen(state: Records) -> None:
    now = state[0]
    now.mode, now.tracks, now.slip, now.agreeing = CORRECTING, now.reopenable, now.ended_slip, 0


@kernel
def follow_ended(smoothed: Records, at: int, rules: Records, state: Records, tracks: Records) -> None:
    """Carry the tracks of the last episode on while its end may still be taken back."""
    now, rule = state[0], rules[0]
    if now.reopenable > 0 and smoothed[at].ready != 0 and tracks[0].t_s < rule.longest_s:
        for k in range(now.reopenable):
            step_track(tracks[k : k + 1], smoothed, at, rule.correction, state)
    else:
        now.reopenable = 0


@kernel
def step_episode(ticks: Records, smoothed: Records, at: int, rules: Records, state: Records, tracks: Records) -> int:
    """All tracks one period on; the number of the one that adheres again, or -1."""
    now, rule = state[0], rules[0]
    found = -1
    for k in range(now.tracks):
        own = tracks[k : k + 1]
        step_track(own, smoothed, at, rule.correction, state)
        again = ticks[at].tacho_missing_s <= 0.0 and adheres_again(smoothed, at, own[0].speed_mps, own[0].t_s, rules)
        own[0].agreeing = own[0].agreeing + 1 if again else 0
        if found < 0 and own[0].agreeing >= rule.periods:
            found = k
    return found


@kernel
def end_episode(
    ticks: Records, smoothed: Records, at: int, chosen: int, rules: Records, state: Records, tracks: Records
) -> float:
    """Take up the wheel again where the chosen track stands; gives the error that this may leave [m]."""
    now, own = state[0], tracks[chosen : chosen + 1]
    distance_m, _, _ = present(own, ticks, at, rules[0].window)
    gap_mps = abs(own[0].speed_mps - smoothed[at].speed_mps)
    bound_m = closed_error(rules, own[0].t_s, now.since_rest_s, gap_mps)
    if now.forced and abs(distance_m - ticks[at].aligned_m - now.offset_m) <= bound_m:
        # The counter went on counting while its messages were missing: nothing speaks against it.
        bound_m = 0.0
    else:
        now.offset_m = distance_m - ticks[at].aligned_m
    _close(ticks[at].t_ns, state)
    return float(bound_m)


@kernel
def _close(t_ns: int, state: Records) -> None:
    now = state[0]
    now.reopenable, now.ended_slip = now.tracks if now.mode == CORRECTING else 0, now.slip
    now.mode, now.slip, now.forced, now.tracks = ADHERING, 0, 0, 0
    now.ended_ns = t_ns


@kernel
def resume_wheel(ticks: Records, smoothed: Records, at: int, rules: Records, state: Records, tracks: Records) -> float:
    """Take up the wheel after a correction that found no end; gives the error that this may leave [m]; -1: not yet.

    Accelerations agree again, speeds do not: the drift of speed is the track's, its way is corrected by the
    likely share of it, and all that the drift may have cost stays in the bound.
    """
    now, own = state[0], tracks[0:1]
    if smoothed[at].ready == 0 or smoothed[at].wheel_ready == 0:
        now.agreeing = 0
        return -1.0
    drift_mps = own[0].speed_mps - smoothed[at].speed_mps
    stuck = smoothed[at].speed_mps == 0.0 and abs(drift_mps) > STUCK_MPS
    agree = abs(smoothed[at].matched_mps2 - smoothed[at].wheel_mps2) <= rules[0].detection_mps2 and not stuck
    now.agreeing = now.agreeing + 1 if agree else 0
    late = own[0].t_s > 2.0 * rules[0].longest_s and abs(smoothed[at].speed_mps) > 1.0
    if now.agreeing < RESUME_TICKS and not late:
        return -1.0
    distance_m, _, _ = present(own, ticks, at, rules[0].window)
    apart_m = distance_m - ticks[at].aligned_m - now.start_offset_m
    drift_m = drift_mps * own[0].t_s
    trusted_m = distance_error(rules, min(own[0].t_s, rules[0].longest_s), now.since_rest_s)
    if late or (now.forced and abs(apart_m) <= trusted_m):
        # The wheel has counted on; what an inertial track of that age says of it belongs to the bound.
        now.offset_m = now.start_offset_m
        bound_m = min(abs(apart_m), 2.0 * trusted_m) if late else 0.0
    else:
        now.offset_m = now.start_offset_m + apart_m - CLOSING_SHARE * drift_m
        bound_m = CLOSING_SHARE * abs(drift_m) + distance_error(rules, min(own[0].t_s, 12.0), now.since_rest_s)
    _close(ticks[at].t_ns, state)
    return float(bound_m)


@kernel
def give_up(ticks: Records, at: int, state: Records, tracks: Records, rules: Records, wrong_axes: int) -> float:
    """Leave a correction that lost its inertial sensor; gives the error that this may leave [m]."""
    now, own = state[0], tracks[0:1]
    distance_m, speed_mps, _ = present(own, ticks, at, rules[0].window)
    now.offset_m = now.start_offset_m if wrong_axes else distance_m - ticks[at].aligned_m
    gap_mps = abs(speed_mps - ticks[at].wheel_speed_mps)
    bound_m = distance_error(rules, own[0].t_s, now.since_rest_s) + gap_mps * 10.0
    _close(ticks[at].t_ns, state)
    now.distrusted = 1
    return float(bound_m)


@kernel
def spread(state: Records, tracks: Records) -> tuple[float, float]:
    """How far the tracks lie above and below the first [m]: a late start point may lie within the slip."""
    above_m = below_m = 0.0
    for k in range(1, state[0].tracks):
        apart_m = tracks[k].distance_m - tracks[0].distance_m
        above_m = max(above_m, apart_m)
        below_m = max(below_m, -apart_m)
    return above_m, below_m


@kernel
def is_overdue(rules: Records, state: Records, tracks: Records) -> bool:
    """Whether the correction has lasted longer than any is given."""
    return bool(state[0].mode == CORRECTING and tracks[0].t_s > rules[0].longest_s - 0.5 * PERIOD_S)


@kernel
def overrun(state: Records) -> None:
    """Go on by the inertial sensor, with a stop demanded."""
    state[0].mode, state[0].distrusted, state[0].agreeing = OVERDUE, 1, 0
