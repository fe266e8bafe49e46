"""Standstill, and the gyros' biases that show in it (Iwata et al., section 3.1.4: sensors are reset at stops)."""

from __future__ import annotations

from typing import Final

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_layout import Record

STILL_TICKS: Final = 13
"""The wheel has not turned for so long."""
STILL_M: Final = 0.004
"""A wheel that has turned by less stands, however many teeth it has: counters made of a measured speed, or with
thousands of teeth, creep by what their sensor errs."""
LONGEST_MEAN_S: Final = 20.0


@kernel
def watch_standstill(tick: Record, pulse_m: float, now: Record, dt_s: float) -> bool:
    """Whether the wheel has stood long enough; takes in the biases of roll and yaw rate while it does.

    The wheel alone cannot tell standing from sliding with locked wheels: what follows for speed and pitch is
    decided branch by branch.
    """
    if abs(tick.way_m - now.stood_m) > max(0.5 * pulse_m, STILL_M):
        now.still, now.stood_m = 0, tick.way_m
    else:
        now.still += 1
    now.since_rest_s += dt_s
    if now.still < STILL_TICKS:
        now.rest_s = 0.0
        return False
    now.rest_s += dt_s
    now.rested_s = min(now.rested_s + dt_s, LONGEST_MEAN_S)
    share = dt_s / now.rested_s
    now.roll_bias_radps += share * (tick.gx_radps - now.roll_bias_radps)
    now.yaw_bias_radps += share * (tick.gz_radps - now.yaw_bias_radps)
    return True
