"""Inertial tracks beside an adhering wheel: what they disagree on belongs to the bound.

Equation (1) does not see a slip that builds up more slowly than the steepest gradient would show. Two tracks,
started anew in turn, say how far wheel and inertial sensor have come apart in the last 8 to 15 seconds.
"""

from __future__ import annotations

from services.numerics.kernel import kernel
from services.odometry_fusion.paper_track import begin_track, step_track
from services.odometry_fusion.tick_layout import Records

WITNESSES = 2
RENEWAL_TICKS = 150
FADING_S = 30.0
"""What a witness saw fades so slowly after it was renewed: its successor began within the slip."""
FACTOR = 1.3
"""A track renewed in the middle of a slip has missed what came before."""


@kernel
def watch_wheel(
    ticks: Records, smoothed: Records, at: int, correction: int, state: Records, witnesses: Records
) -> float:
    """All witnesses one tick on; the bound's share of their disagreement with the wheel [m]."""
    now = state[0]
    apart_m = 0.0
    for k in range(WITNESSES):
        own = witnesses[k : k + 1]
        if smoothed[at].ready == 0 or smoothed[at].wheel_ready == 0:
            own[0].start_ns = 0
            own[0].t_s = -1.0
            continue
        phase = (now.watched + k * (RENEWAL_TICKS // WITNESSES)) % RENEWAL_TICKS
        if own[0].t_s < 0.0 or phase == 0:
            begin_track(own, smoothed, at, ticks[at].t_ns, now.offset_m, state)
            continue
        step_track(own, smoothed, at, correction, state)
        apart_m = max(apart_m, abs(own[0].distance_m - now.offset_m - smoothed[at].way_m))
    now.watched += 1
    return FACTOR * apart_m


@kernel
def dismiss(witnesses: Records) -> None:
    """Begin with new witnesses at the next tick."""
    for k in range(WITNESSES):
        witnesses[k].t_s = -1.0
