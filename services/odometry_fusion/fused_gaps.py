"""Pulses that stayed away: whether the counter counted on meanwhile, and whether both sensors' stamps are late since.

When counts come back, what they say of the gap is believed if it fits what the accounts expect. If not, pulses were
lost, or the stamps are late from now on: nothing is said of a slip, the rim's way is tied anew to the train's, and the
way over the gap is that of the inertial sensor, or of the speed that was held.

Both sensors missing at once, with a counter that then goes on from where it was, is what two sensors look like that
have become late by the length of the gap. The train is then v T ahead of what they show. That much has been added over
the gap, at the speed v₀ of that time; what else they hide is T (v - v₀), and its range is vouched for as long as
the accounts last.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_layout import Branches, Record, U, V, W

TOLERANCE_SIGMA: Final = 4.0
TOLERANCE_M: Final = 0.5
STOOD_SHARE: Final = 0.4
"""A counter that has come less far over the gap than this share of what was expected has not counted on."""
LEAST_WAY_M: Final = 1.0
LATE_TICKS: Final = 3
"""For so long both were missing, beyond what is bridged."""
SPARE_S: Final = 0.1
"""The length of the gap is known to within a tick."""


@kernel
def watch_gap(tick: Record, now: Record, blind: bool, silent: bool, latency_ticks: int) -> bool:  # noqa: FBT001 - a kernel takes its arguments by place
    """Whether counts are missing, `silent` as seen now: until the wheel's delay has passed, too.

    Else the way at an instant within the gap would be measured, on the straight between the counts around it.
    """
    if silent:
        now.gap_s = tick.tacho_missing_s
        now.both_ticks += 1 if blind else 0
        now.returning = latency_ticks + 2
        return True
    if now.returning > 0:
        if now.returning == latency_ticks + 2:
            now.came_m = tick.way_m - now.count_m
        now.returning -= 1
        return bool(now.returning > 0)
    if tick.tacho_missing_s == 0.0:
        now.count_m = tick.way_m
    now.gap_s, now.both_ticks = 0.0, 0
    return False


@kernel
def bridge_gap(tick: Record, now: Record, branches: Branches, variance: float, dt_s: float) -> None:
    """The first count after a gap that is used: tie the rim anew unless it fits."""
    best = branches.x[now.best]
    expected_m = best[W] + (best[V] + best[U]) * dt_s
    spread_m = np.sqrt(branches.p[now.best, W, W] + variance)
    missing_s = now.gap_s + SPARE_S
    way_m = abs(best[V]) * missing_s
    late = now.both_ticks >= LATE_TICKS and abs(now.came_m) < STOOD_SHARE * way_m and way_m > LEAST_WAY_M
    if late:
        if now.late_s == 0.0:
            now.late_least_mps = now.late_most_mps = best[V]
        now.late_s += missing_s
    if late or abs(tick.aligned_m - expected_m) > TOLERANCE_SIGMA * spread_m + TOLERANCE_M:
        for i in range(now.branches):
            x, p = branches.x[i], branches.p[i]
            x[W] = tick.aligned_m - (x[V] + x[U]) * dt_s
            p[W, :] = 0.0
            p[:, W] = 0.0
            p[W, W] = variance


@kernel
def hidden_by_lateness(now: Record, speed_mps: float) -> float:
    """What late sensors may hide of the way [m]: the range of speeds since times the lateness."""
    if now.late_s == 0.0:
        return 0.0
    now.late_least_mps = min(now.late_least_mps, speed_mps)
    now.late_most_mps = max(now.late_most_mps, speed_mps)
    return float(now.late_s * (now.late_most_mps - now.late_least_mps))
