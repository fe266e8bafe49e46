"""Pitch and roll from the start point on, and the forward acceleration freed of gravity (Iwata et al., (2)-(12)).

Pitch is positive nose up, roll positive right side down, angular rates alike; yaw is positive to the left.
"""

from __future__ import annotations

import math

from services.numerics.kernel import kernel
from services.odometry_fusion.paper_layout import CONSTANT, GRAVITY_MPS2, NONE, YAW_AND_ROLL


@kernel
def forward_acceleration(ax_mps2: float, pitch_rad: float) -> float:
    """Equation (2): Ax = ax - G sin θ."""
    return ax_mps2 - GRAVITY_MPS2 * math.sin(pitch_rad)


@kernel
def initial_pitch(ax_mps2: float, wheel_mps2: float) -> float:
    """Equation (3): θ0 = arcsin((ax0 - Ap0) / G), held to what arcsin takes."""
    return math.asin(min(1.0, max(-1.0, (ax_mps2 - wheel_mps2) / GRAVITY_MPS2)))


@kernel
def initial_roll(ay_mps2: float, az_mps2: float, speed_mps: float, yaw_radps: float) -> float:
    """Equation (11): ψ0 = arctan((ay0 - v0 ωz0) / Az0).

    It is (8) with the lateral force of (10), Ay0 = -(ay0 - v0 ωz0), which is (9) for small roll; (8) is (7) where
    the forward force is small against the vertical one.
    """
    return math.atan2(ay_mps2 - speed_mps * yaw_radps, az_mps2)


@kernel
def pitch_rate(correction: int, roll_radps: float, pitch_radps: float, yaw_radps: float, roll_rad: float) -> float:
    """Rate whose integral is the pitch, equation (4): θ(t) = θ0 + ∫ rate dt.

    (5): ωy' = ωy + ωz sin ψ. (12): ωy'' = ωy' - k ωx sin ψ, k = -1 in curves to the right and +1 to the left.
    """
    if correction == CONSTANT:
        return 0.0
    if correction == NONE:
        return pitch_radps
    rate = pitch_radps + yaw_radps * math.sin(roll_rad)
    if correction == YAW_AND_ROLL:
        side = 1.0 if yaw_radps > 0.0 else -1.0
        rate -= side * roll_radps * math.sin(roll_rad)
    return rate
