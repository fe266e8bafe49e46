"""How well the wheel's way is measured: teeth, and jitter of the times at which counts are taken."""

from __future__ import annotations

from typing import Final

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_layout import Record

LEAST_SHARE: Final = 0.003
"""The jitter is a mean over half a minute."""
WHITE_GAIN: Final = 20.0
"""Variance of the third difference of white noise over its own: 1 + 9 + 9 + 1. Motion shows in it by jerk alone."""
LEAST_SIGMA_M: Final = 0.004
"""No wheel rolls better than this, however many teeth it has."""
LEAST_TICKS: Final = 4
LONGEST_STILL: Final = 20.0


@kernel
def rim_variance(z_m: float, pulse_m: float, now: Record, dt_s: float) -> float:
    """Variance [m²] of the way at hand, and the rim's speed into `now`.

    Counting teeth errs evenly over one of them: pulse²/12. While fewer than one passes per tick, errors repeat
    instead of averaging out, and the variance is raised by as much.
    """
    teeth_m2 = max(pulse_m * pulse_m / 12.0, LEAST_SIGMA_M**2)
    now.followed += 1
    if now.followed >= LEAST_TICKS:
        third_m = z_m - 3.0 * now.z1_m + 3.0 * now.z2_m - now.z3_m
        speed2 = now.rim_mps * now.rim_mps
        share = max(LEAST_SHARE, 1.0 / (now.followed - LEAST_TICKS + 1))
        known_m2 = teeth_m2 + max(now.jitter_m2, 0.0) / max(now.jitter_mps2, 1.0) * speed2
        now.jitter_m2 += share * (min(third_m * third_m / WHITE_GAIN, 9.0 * known_m2) - teeth_m2 - now.jitter_m2)
        now.jitter_mps2 += share * (speed2 - now.jitter_mps2)
    if now.followed >= LEAST_TICKS - 1:
        now.rim_mps = (z_m - now.z2_m) / (2.0 * dt_s)
    now.z3_m, now.z2_m, now.z1_m = now.z2_m, now.z1_m, z_m
    jitter_m2 = max(now.jitter_m2, 0.0) / max(now.jitter_mps2, 1.0) * now.rim_mps * now.rim_mps
    repeated = pulse_m / (abs(now.rim_mps) * dt_s + 1e-9)
    return float((teeth_m2 + jitter_m2) * max(1.0, min(LONGEST_STILL, repeated)))
