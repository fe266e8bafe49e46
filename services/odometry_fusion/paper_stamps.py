"""Counts whose times jitter: how much, and what that does to the paper's thresholds.

Ap is a difference of speeds, and a count that is stamped by 8 ms too late is a way that is wrong by 0.16 m at 20 m/s:
0.16 m/s² of Ap. Equation (1) would take that for slips.
"""

from __future__ import annotations

from typing import Final

from services.numerics.kernel import kernel
from services.odometry_fusion.motion_log import PERIOD_S
from services.odometry_fusion.tick_layout import Records

WHITE_GAIN: Final = 20.0
"""Variance of the third difference of white noise over its own: 1 + 9 + 9 + 1. Motion shows in it by jerk alone."""
LEAST_MPS: Final = 3.0
"""Slower, teeth hide the jitter."""
MEAN_TICKS: Final = 600
LARGEST_STEP: Final = 9.0
LEAST_S2: Final = 2.5e-7
"""Half a millisecond: what a step may show at the very beginning."""
SIGMAS: Final = 4.0
"""Of Ap, by which thresholds exceed what the jitter alone shows: an hour has 36,000 ticks."""
FAR: Final = 2.0
"""Ta is so many times wider than its headroom when the status tells of it."""


@kernel
def watch_stamps(ticks: Records, at: int, pulse_m: float, adheres: bool, state: Records) -> None:  # noqa: FBT001 - a kernel takes its arguments by place
    """Take in the third difference of the ways at hand, a mean over a minute of running."""
    now, tick = state[0], ticks[at]
    third_m = tick.aligned_m - 3.0 * now.z1_m + 3.0 * now.z2_m - now.z3_m
    now.z3_m, now.z2_m, now.z1_m = now.z2_m, now.z1_m, tick.aligned_m
    speed2 = tick.wheel_speed_mps * tick.wheel_speed_mps
    if not adheres or tick.tacho_missing_s > 0.0 or speed2 < LEAST_MPS * LEAST_MPS or at < 10:  # noqa: PLR2004 - the delay of the first counts
        return
    now.stamped = min(now.stamped + 1, MEAN_TICKS)
    seen_s2 = max(0.0, third_m * third_m / WHITE_GAIN - pulse_m * pulse_m / 12.0) / speed2
    most_s2 = LARGEST_STEP * (now.jitter_s2 + LEAST_S2) if now.stamped > 10 else seen_s2  # noqa: PLR2004 - a second
    now.jitter_s2 += (min(seen_s2, most_s2) - now.jitter_s2) / now.stamped


@kernel
def wheel_acceleration_sigma(rules: Records, state: Records, speed_mps: float) -> float:
    """Standard deviation of Ap by the jitter [m/s²]: four ways, over the speeds' windows and the time between them."""
    speed_s = rules[0].speed_window * PERIOD_S
    return float(2.0 * abs(speed_mps) * state[0].jitter_s2 ** 0.5 / (speed_s * (rules[0].window * PERIOD_S - speed_s)))


@kernel
def widen(rules: Records, state: Records, speed_mps: float, in_force: Records) -> bool:
    """Fill the rules that are in force at this jitter; gives whether they are much wider."""
    rule, own = rules[0], in_force[0]
    if rule.watches_stamps == 0:
        return False
    sigma_mps2 = wheel_acceleration_sigma(rules, state, speed_mps)
    more_mps2 = max(0.0, SIGMAS * sigma_mps2 - rule.headroom_mps2)
    own.detection_mps2 = rule.detection_mps2 + more_mps2
    own.headroom_mps2 = rule.headroom_mps2 + more_mps2
    # From tick to tick twice as many ways go into it.
    jerk = SIGMAS * 2.0**0.5 * sigma_mps2 if more_mps2 > 0.0 else 0.0
    own.jerk_wheel = max(rule.jerk_wheel, jerk)
    own.jerk_difference = max(rule.jerk_difference, jerk)
    own.threshold_error_mps2 = rule.threshold_error_mps2 + more_mps2
    return bool(SIGMAS * sigma_mps2 > FAR * rule.headroom_mps2)
