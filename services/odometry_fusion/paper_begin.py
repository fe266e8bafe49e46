"""Logs that begin in motion: until the wheel has been seen to adhere, it may be slipping already.

No start point can be told apart from a slip then, so that no correction is begun; the wheel's way is given, degraded,
with what its slips may have cost since the first count.
"""

from __future__ import annotations

from typing import Final

from services.numerics.kernel import kernel
from services.odometry_fusion.motion_log import PERIOD_S
from services.odometry_fusion.paper_layout import ADHERING
from services.odometry_fusion.tick_layout import Records

AGREEMENT_S: Final = 12.0
"""Nine of ten slips are over by then: a wheel that has agreed for so long with the inertial sensor adheres."""
REST_TICKS: Final = 50
BEGUN_REST_TICKS: Final = 150
"""So long a standstill is none of a locked wheel's, the latter where the wheel has turned before."""
SLIP_MPS: Final = 4.0
"""A slip under way costs so much,"""
SLIP_M: Final = 20.0
"""and at worst so much."""
WILD_MPS: Final = 5.0
"""A wheel that seemed to stand, and differs by so much soon after, was locked."""
FIRST_S: Final = 0.5
MOVING_MPS: Final = 0.5


@kernel
def watch_beginning(
    ticks: Records,
    smoothed: Records,
    at: int,
    differ: bool,  # noqa: FBT001 - a kernel takes its arguments by place
    state: Records,
    witnesses: Records,
) -> bool:
    """Whether the wheel has not been seen to adhere yet; what it may have slipped before goes into the excess."""
    now = state[0]
    if now.fresh_s < 0.0:
        return False
    if now.fresh_s < FIRST_S and abs(ticks[at].wheel_speed_mps) > MOVING_MPS:
        now.begun = 1
    now.fresh_s += PERIOD_S
    ready = smoothed[at].ready != 0 and smoothed[at].wheel_ready != 0
    if ready and now.mode == ADHERING:
        for k in range(len(witnesses)):
            if witnesses[k].t_s > 0.0:
                now.fresh_mps = max(now.fresh_mps, abs(witnesses[k].speed_mps - smoothed[at].speed_mps))
        if now.fresh_mps > WILD_MPS:
            now.begun = 1
    if differ or not ready:
        now.fresh_until_s = now.fresh_s
    if (
        now.rest_ticks >= (BEGUN_REST_TICKS if now.begun else REST_TICKS)
        or now.fresh_s - now.fresh_until_s > AGREEMENT_S
    ):
        now.excess_m += beginning_error(state)
        now.fresh_s = -1.0
        return False
    return True


@kernel
def beginning_error(state: Records) -> float:
    """What slips since the first count may have cost [m]: the largest difference of speed as long as they differed."""
    now = state[0]
    if now.fresh_s < 0.0 or now.begun == 0:
        return 0.0
    return float(min(SLIP_M, SLIP_MPS * now.fresh_until_s) + now.fresh_mps * now.fresh_until_s)
