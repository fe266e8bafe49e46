"""The largest error that a correction can leave (Iwata et al., equation (13))."""

from __future__ import annotations

from services.numerics.kernel import kernel
from services.odometry_fusion.paper_layout import GRAVITY_MPS2
from services.odometry_fusion.tick_layout import Records


@kernel
def gyro_error(rules: Records, since_rest_s: float) -> float:
    """Error of the pitch rate [rad/s]: half of ① right after the biases were reset at rest, all of it at `bias_hold_s`.

    It goes on growing beyond: a train that has not stood for long knows its biases less and less.
    """
    rule = rules[0]
    return float(rule.gyro_error_radps * (0.5 + 0.5 * since_rest_s / rule.bias_hold_s))


@kernel
def acceleration_error(rules: Records, t_s: float, since_rest_s: float) -> float:
    """Δa = ① mean tilt by the gyro's error over the correction + ② accelerometer + ③ start point's threshold."""
    rule = rules[0]
    tilt_mps2 = GRAVITY_MPS2 * gyro_error(rules, since_rest_s) * t_s / 2.0
    return float(tilt_mps2 + rule.accelerometer_error_mps2 + rule.threshold_error_mps2)


@kernel
def distance_error(rules: Records, t_s: float, since_rest_s: float) -> float:
    """Equation (13): Δd = ½ Δa t², t the correction time so far."""
    return 0.5 * acceleration_error(rules, t_s, since_rest_s) * t_s * t_s


@kernel
def closed_error(rules: Records, t_s: float, since_rest_s: float, speed_gap_mps: float) -> float:
    """Error of a correction that ended in re-adhesion, never above (13).

    The wheel, adhering again, shows how far the speed had drifted: an acceleration that was wrong throughout by Δa
    leaves Δv = Δa t and Δd = ½ Δv t. What was not constant, and what the wheel does not show, is ② over the time.
    """
    rule = rules[0]
    seen_m = 0.5 * speed_gap_mps * t_s + 0.5 * rule.accelerometer_error_mps2 * t_s * t_s
    return float(min(distance_error(rules, t_s, since_rest_s), seen_m + 1.0 + speed_gap_mps))
