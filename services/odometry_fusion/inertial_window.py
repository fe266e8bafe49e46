"""What the inertial sensor's means tell beside motion: their noise, and the roll angle."""

from __future__ import annotations

from typing import Final

import numpy as np

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_layout import GRAVITY_MPS2, Record

ROLL_TIME_S: Final = 6.0
"""The roll rate counts for shorter, the lateral acceleration for longer."""
NOISE_TIME_S: Final = 20.0
MOST_PITCH_RAD: Final = 0.3
LARGEST_STEP: Final = 9.0
"""A difference counts for at most so many times its variance."""


@kernel
def next_roll(
    roll_rad: float,
    ay_mps2: float,
    gx_radps: float,
    gz_radps: float,
    pitch_rad: float,
    speed_mps: float,
    dt_s: float,
    settled_s: float,
) -> float:
    """Roll angle [rad], right side down positive, after a step; `settled_s` is how long the filter has run.

    A complementary filter: the roll rate integrated, drawn towards (ay - v ωz)/g, the lateral acceleration freed from
    the centripetal one (Iwata et al., equations 6 and 11). The sensor's mounting shows in it too, as it must: what
    leaks of the yaw rate into the pitch rate follows the sensor's own roll. Of a sensor whose nose is up the x axis
    leans towards the vertical, and shows ωz tan θ that is no roll: little on gradients, much with 3° of mounting.
    """
    seen_rad = (ay_mps2 - speed_mps * gz_radps) / GRAVITY_MPS2
    turned_rad = roll_rad + (gx_radps - gz_radps * np.tan(pitch_rad)) * dt_s
    return float(turned_rad + dt_s / max(min(ROLL_TIME_S, settled_s), dt_s) * (seen_rad - turned_rad))


@kernel
def next_variance(variance: float, step: float, share: float) -> float:
    """Running variance of a noise, after a step from one sample to the next: half its square, clipped.

    What changes slowly (gradient, braking) hardly shows in such steps; vibration and the sensor's noise do.
    """
    return variance + share * (min(0.5 * step * step, LARGEST_STEP * variance) - variance)


@kernel
def sense(tick: Record, now: Record, speed_mps: float, pitch_rad: float, dt_s: float) -> None:
    """Take one mean of the inertial sensor in: noises and roll angle."""
    now.roll_settled_s += dt_s
    now.roll_rad = next_roll(
        now.roll_rad,
        tick.ay_mps2,
        tick.gx_radps - now.roll_bias_radps,
        tick.gz_radps - now.yaw_bias_radps,
        min(max(pitch_rad, -MOST_PITCH_RAD), MOST_PITCH_RAD),
        speed_mps,
        dt_s,
        now.roll_settled_s,
    )
    if now.noise_s > 0.0:
        share = min(1.0, dt_s / min(NOISE_TIME_S, now.noise_s))
        now.force_var = next_variance(now.force_var, tick.ax_mps2 - now.ax_mps2, share)
        now.rate_var = next_variance(now.rate_var, tick.gy_radps - now.gy_radps, share)
    now.noise_s += dt_s
    now.ax_mps2, now.gy_radps = tick.ax_mps2, tick.gy_radps
