"""Inertial tracks beside an adhering wheel: what they disagree on belongs to the bound.

Equation (1) does not see a slip that builds up more slowly than the steepest gradient would show. Two tracks,
started anew in turn, say how far wheel and inertial sensor have come apart in the last 8 to 15 seconds. So do, for a
while, the tracks of an episode that has ended: if it ended while the wheel still slipped, they are right.
"""

from __future__ import annotations

from services.numerics.kernel import kernel
from services.odometry_fusion.motion_log import PERIOD_S
from services.odometry_fusion.paper_episode import is_unconfirmed
from services.odometry_fusion.paper_track import begin_track, step_track
from services.odometry_fusion.tick_layout import Records

WITNESSES = 2
RENEWAL_TICKS = 150
CLEAR_TICKS = 10
"""So long after an episode's end, and a window, none of its slip is in the means that a witness begins with."""
FADING_S = 30.0
"""What a witness saw fades so slowly after it was renewed: its successor began within the slip."""
FACTOR = 1.5
"""A track renewed in the middle of a slip has missed what came before: up to a third where the slip speed is steady."""
NOISE_MPS = 0.3
"""By so much the speed of a witness is off when its time is over; more than that is a slip's, and its successor begins
with the wheel's speed: what that will not see goes on to grow in the bound."""
SUSPECT_M = 4.0
"""A start point within a slip is betrayed by so much: a witness, with a steady gyro, errs by half of it."""


@kernel
def watch_wheel(
    ticks: Records, smoothed: Records, at: int, rules: Records, state: Records, witnesses: Records
) -> float:
    """All witnesses one tick on; the bound's share of their disagreement with the wheel [m], positive if it lags."""
    now, rule = state[0], rules[0]
    apart_m = 0.0
    for k in range(WITNESSES):
        own = witnesses[k : k + 1]
        soiled = ticks[max(0, at - rule.window - CLEAR_TICKS)].t_ns <= now.ended_ns
        if smoothed[at].ready == 0 or smoothed[at].wheel_ready == 0 or soiled:
            own[0].start_ns = 0
            own[0].t_s = -1.0
            continue
        phase = (now.watched + k * (RENEWAL_TICKS // WITNESSES)) % RENEWAL_TICKS
        if own[0].t_s < 0.0 or phase == 0:
            gap_mps = abs(own[0].speed_mps - smoothed[at].speed_mps) if own[0].t_s > 0.0 else 0.0
            now.inherited_mps = max(0.0, gap_mps - NOISE_MPS)
            begin_track(own, smoothed, at, ticks[at].t_ns, now.offset_m, state)
            continue
        step_track(own, smoothed, at, rule.correction, state)
        lead_m = own[0].distance_m - now.offset_m - smoothed[at].way_m
        if abs(lead_m) > abs(apart_m):
            apart_m = lead_m
    now.watched += 1
    return FACTOR * apart_m


@kernel
def compare_wheel(
    ticks: Records,
    smoothed: Records,
    at: int,
    rules: Records,
    state: Records,
    tracks: Records,
    witnesses: Records,
) -> None:
    """Keep what witnesses, and tracks of an end that nothing has confirmed, disagree on with the adhering wheel."""
    now = state[0]
    lead_m = watch_wheel(ticks, smoothed, at, rules, state, witnesses)
    seen_m = abs(lead_m)
    if is_unconfirmed(ticks, at, state):
        for k in range(now.reopenable):
            seen_m = max(seen_m, abs(tracks[k].distance_m - now.offset_m - smoothed[at].way_m))
    if seen_m >= now.apart_m:
        now.lead_m = lead_m
    fade_wheel(state)
    now.apart_m = max(seen_m, now.apart_m + FACTOR * now.inherited_mps * PERIOD_S)


@kernel
def fade_wheel(state: Records) -> None:
    """What was seen fades."""
    state[0].apart_m *= 1.0 - PERIOD_S / FADING_S


@kernel
def doubt_start(undone_m: float, unconfirmed: bool, undetected_m: float, state: Records) -> None:  # noqa: FBT001 - a kernel takes its arguments by place
    """Set what witnesses saw against the correction so far: a start point may lie in a slip which built up slowly.

    What the correction leaves of it stays in the bound. If that is much, or the two contradict each other, or the last
    end was not confirmed, the start point is suspect, and until the end the wheel may be right as well.
    """
    now = state[0]
    now.unseen_m = max(now.unseen_m, now.apart_m - abs(undone_m))
    against = undone_m * now.lead_m < 0.0 and now.apart_m > undetected_m
    contrary_m = now.apart_m + abs(undone_m) if against else now.unseen_m
    now.suspect = 1 if unconfirmed or contrary_m > SUSPECT_M else 0


@kernel
def dismiss(state: Records, witnesses: Records) -> None:
    """Begin with new witnesses at the next tick."""
    for k in range(WITNESSES):
        witnesses[k].t_s = -1.0
    state[0].inherited_mps = 0.0
