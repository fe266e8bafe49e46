"""Re-adhesion: wheel and inertial sensor agree again (Iwata et al., section 3.1.3)."""

from __future__ import annotations

from services.numerics.kernel import kernel
from services.odometry_fusion.paper_detection import accelerations_differ
from services.odometry_fusion.paper_start_point import is_calm
from services.odometry_fusion.tick_layout import Records


@kernel
def adheres_again(smoothed: Records, at: int, speed_mps: float, t_s: float, rules: Records) -> bool:
    """Whether |ax - Ap| <= Ta and |speed - wheel| <= β t, t the correction time; by a switch the jerk test, too."""
    now, rule = smoothed[at], rules[0]
    if now.wheel_ready == 0 or accelerations_differ(now.matched_mps2, now.wheel_mps2, rule.detection_mps2):
        return False
    if abs(speed_mps - now.speed_mps) > rule.beta_mps2 * t_s:
        return False
    if rule.jerk_at_readhesion == 0:
        return True
    return is_calm(smoothed, at, rule.jerk_imu, rule.jerk_wheel, rule.jerk_difference)
