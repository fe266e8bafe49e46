"""A car body on curved, canted, graded track: what an inertial sensor in it would feel if it were perfect.

Attitude is that of the track (pitch up θ from the slope, roll φ from cant) plus the suspension's: the
body squats and dives with acceleration and leans outwards under unbalanced lateral acceleration, both
as damped oscillators that the track's roughness shakes. With heading rate ψ' = v κ, axes x forward,
y left, z up, specific force and right-handed rates:

    fx = a + g sin θ        fy = v² κ cos φ + (g cos θ + v² θs) sin φ        fz = -v² κ sin φ + (g cos θ + v² θs) cos φ
    gx = φ' + ψ' sin θ      gy = -θ' cos φ + ψ' cos θ sin φ                  gz = θ' sin φ + ψ' cos θ cos φ

θs being the change of the track's slope per metre. Iwata et al., equations (2) and (5), are these
resolved for θ, their pitch rate counting upwards.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import kernel
from services.simulator.motion_state import STEP_S, VehicleConstants
from services.simulator.train_dynamics import GRAVITY

Floats = NDArray[np.float64]

PITCH_RADPS: Final = 2.0 * np.pi * 1.1
"""Natural frequency of the pitching body."""
ROLL_RADPS: Final = 2.0 * np.pi * 0.8
DAMPING: Final = 0.25
PITCH_ROUGH_RADPS: Final = 0.0025
"""Rate that the track shakes the body with at 20 m/s, one standard deviation."""
ROLL_ROUGH_RADPS: Final = 0.004
ROUGH_AT_MPS: Final = 20.0


@kernel
def suspend(state: Any, felt: Floats, vibration: float, noise: Floats, c: VehicleConstants) -> None:  # noqa: ANN401 - a numpy record
    """One step of the body on its suspension; `felt` is curvature, slope, roll of the track; two normals of noise."""
    s = state[0]
    rough = vibration * s.speed_mps / ROUGH_AT_MPS
    unbalanced = s.speed_mps * s.speed_mps * felt[0] + GRAVITY * felt[2]
    aims = (c.pitch_per_mps2 * s.acceleration_mps2, c.roll_flexibility * unbalanced / GRAVITY)
    push = PITCH_RADPS * PITCH_RADPS * (aims[0] - s.pitch_rad) - 2.0 * DAMPING * PITCH_RADPS * s.pitch_radps
    shake = PITCH_ROUGH_RADPS * np.sqrt(4.0 * DAMPING * PITCH_RADPS * STEP_S)
    s.pitch_radps += push * STEP_S + rough * shake * noise[0]
    s.pitch_rad += s.pitch_radps * STEP_S
    push = ROLL_RADPS * ROLL_RADPS * (aims[1] - s.roll_rad) - 2.0 * DAMPING * ROLL_RADPS * s.roll_radps
    shake = ROLL_ROUGH_RADPS * np.sqrt(4.0 * DAMPING * ROLL_RADPS * STEP_S)
    s.roll_radps += push * STEP_S + rough * shake * noise[1]
    s.roll_rad += s.roll_radps * STEP_S


@kernel
def feel(state: Any, felt: Floats, bend: Floats, out: Floats) -> None:  # noqa: ANN401 - a numpy record
    """Specific force and rates now, into `out` (6,); `bend` is the change per metre of `felt`."""
    s = state[0]
    v = s.speed_mps
    pitch, roll = np.arcsin(felt[1]) + s.pitch_rad, felt[2] + s.roll_rad
    turn = v * felt[0]
    pitch_rate, roll_rate = v * bend[1] + s.pitch_radps, v * bend[2] + s.roll_radps
    sin_p, cos_p, sin_r, cos_r = np.sin(pitch), np.cos(pitch), np.sin(roll), np.cos(roll)
    up = GRAVITY * cos_p + v * v * bend[1]
    side = v * turn
    out[0] = s.acceleration_mps2 + GRAVITY * sin_p
    out[1] = side * cos_r + up * sin_r
    out[2] = up * cos_r - side * sin_r
    out[3] = roll_rate + turn * sin_p
    out[4] = turn * cos_p * sin_r - pitch_rate * cos_r
    out[5] = turn * cos_p * cos_r + pitch_rate * sin_r
