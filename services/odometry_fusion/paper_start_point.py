"""Where the wheel still adhered: the start point of a correction (Iwata et al., sections 3.1.2 (2) and 4.3.1)."""

from __future__ import annotations

from services.numerics.kernel import kernel
from services.odometry_fusion.tick_layout import Records


@kernel
def is_calm(smoothed: Records, at: int, jerk_imu: float, jerk_wheel: float, jerk_difference: float) -> bool:
    """Whether both accelerations are steady and change alike: |Ji|, |Jp| and |Ji - Jp| within their limits."""
    now = smoothed[at]
    return bool(
        now.ready != 0
        and now.wheel_ready != 0
        and abs(now.jerk_imu) <= jerk_imu
        and abs(now.jerk_wheel) <= jerk_wheel
        and abs(now.jerk_imu - now.jerk_wheel) <= jerk_difference
    )


@kernel
def slips_already(smoothed: Records, at: int, rules: Records) -> bool:
    """Whether equation (3) would give a gradient that no line has: the wheel slips there, however steady.

    Ta once more its headroom: where sensor and mounting are off, the steepest gradient crosses Ta by little.
    """
    most_mps2 = rules[0].detection_mps2 + rules[0].headroom_mps2
    return bool(abs(smoothed[at].matched_mps2 - smoothed[at].wheel_mps2) > most_mps2)


@kernel
def start_point(smoothed: Records, latest: int, earliest: int, rules: Records) -> int:
    """Last tick in [earliest, latest] that ends a run of calm ones; -1 where there is none.

    `latest` already lies the look-back before detection: a wheel that creeps into its slip may look calm.
    """
    rule = rules[0]
    run = 0
    for k in range(latest, earliest - 1, -1):
        calm = is_calm(smoothed, k, rule.jerk_imu, rule.jerk_wheel, rule.jerk_difference)
        run = run + 1 if calm and not slips_already(smoothed, k, rules) else 0
        if run >= rule.periods:
            return int(k + rule.periods - 1)
    return -1


@kernel
def least_jerk(smoothed: Records, latest: int, earliest: int, rules: Records) -> int:
    """The ready tick in [earliest, latest] whose jerks differ least, for want of a start point; -1 for none."""
    best = -1
    for k in range(latest, earliest - 1, -1):
        if smoothed[k].ready == 0 or smoothed[k].wheel_ready == 0 or slips_already(smoothed, k, rules):
            continue
        if best < 0 or abs(smoothed[k].jerk_imu - smoothed[k].jerk_wheel) < abs(
            smoothed[best].jerk_imu - smoothed[best].jerk_wheel
        ):
            best = k
    return best
