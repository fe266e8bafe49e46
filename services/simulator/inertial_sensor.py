"""An inertial sensor: mounting, scale, bias with its drift, noise, vibration of the car, quantisation, saturation.

Figures of a grade are those of data sheets (Analog Devices ADIS16480 rev. H, table 1; for `mems` usual ones
of consumer parts such as the MPU-6050 and BMI160); white noise of density N has a standard deviation of
N·sqrt(rate/2) per sample.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import kernel
from services.simulator.motion_settings import Imu
from services.simulator.motion_state import STEP_S

Floats = NDArray[np.float64]

DEG: Final = np.pi / 180.0
MILLI_G: Final = 9.80665e-3
DRIFT_S: Final = 300.0
"""Correlation time of the wandering bias."""


class Grading(NamedTuple):
    """One grade's figures; gyro first, accelerometer second."""

    noise: tuple[float, float]
    """Density [rad/s/√Hz], [m/s²/√Hz]."""
    wander: tuple[float, float]
    """Standard deviation of the bias about its mean."""
    bias: tuple[float, float]
    """Spread of the residual bias after calibration at rest."""
    per_c: tuple[float, float]
    """Spread of the bias's change with temperature, per kelvin."""
    scale: tuple[float, float]
    """Spread of scale factor and of axes' misalignment."""
    span: tuple[float, float]
    """Largest reading."""
    step: tuple[float, float]
    """Least step of a reading."""


GRADES: Final = {
    "adis16480": Grading(
        (0.0066 * DEG, 0.067 * MILLI_G),
        (6.25 / 3600.0 * DEG, 0.1 * MILLI_G),
        (0.015 * DEG, 2.0 * MILLI_G),
        (0.0025 * DEG, 0.1 * MILLI_G),
        (1e-3, 5e-4),
        (450.0 * DEG, 10e3 * MILLI_G),
        (3.05e-7 * DEG, 1.2e-5 * MILLI_G),
    ),
    "mems": Grading(
        (0.007 * DEG, 0.3 * MILLI_G),
        (0.01 * DEG, 1.0 * MILLI_G),
        (0.05 * DEG, 8.0 * MILLI_G),
        (0.02 * DEG, 0.8 * MILLI_G),
        (5e-3, 5e-3),
        (250.0 * DEG, 2e3 * MILLI_G),
        (7.6e-3 * DEG, 0.061 * MILLI_G),
    ),
}
MODES: Final = np.array(
    [  # axis, frequency [Hz], damping, standard deviation at 20 m/s [m/s² or rad/s]
        (0, 0.9, 0.20, 0.012),  # surging between couplers
        (0, 6.5, 0.10, 0.025),
        (1, 1.3, 0.20, 0.050),  # swaying
        (1, 5.2, 0.10, 0.070),
        (1, 21.0, 0.20, 0.140),
        (2, 1.2, 0.20, 0.060),  # bouncing
        (2, 8.6, 0.08, 0.160),  # bending
        (2, 31.0, 0.20, 0.280),  # bogie
        (3, 5.8, 0.10, 0.0060),
        (4, 8.6, 0.08, 0.0040),
        (5, 1.1, 0.25, 0.0018),  # hunting
        (5, 4.1, 0.15, 0.0020),
    ]
)
AT_MPS: Final = 20.0
IDLE: Final = 0.015
"""Share of the vibration that remains at rest: compressors, doors, wind."""
ROUND_MPS2: Final = (0.03, 0.0, 0.08)
"""Vibration once per revolution of wheels out of round at AT_MPS; it grows with the square of speed."""
NOISES: Final = 12 + len(MODES)


class SensorConstants(NamedTuple):
    """One sensor as drawn, for the kernel."""

    turned: Floats
    """(6, 6): body to sensor, scale and misalignment included."""
    bias: Floats
    """(6,) accelerometers first, as everywhere below."""
    per_c: Floats
    warm_c: float
    warm_up_s: float
    white: Floats
    wander: Floats
    span: Floats
    least: Floats
    modes: Floats
    """(k, 5): axis, two feedback coefficients, gain, standard deviation."""
    vibration: float
    revolutions_per_m: float


def drawn_sensor(imu: Imu, wheel_diameter_m: float, generator: np.random.Generator) -> SensorConstants:
    """A sensor of the settings; the same generator state gives the same one."""
    grade = GRADES[imu.grade]

    def six(of: tuple[float, float]) -> Floats:
        return np.repeat([of[1], of[0]], 3)

    bias = six(grade.bias) * generator.standard_normal(6)
    signs = generator.choice((-1.0, 1.0), 6)
    if imu.accelerometer_bias_mps2 is not None:
        bias[:3] = signs[:3] * imu.accelerometer_bias_mps2
    if imu.gyro_bias_dps is not None:
        bias[3:] = signs[3:] * imu.gyro_bias_dps * DEG
    angles = imu.mounting_sigma_deg * generator.standard_normal(3)
    if imu.mounting_deg is not None:
        angles = np.array(imu.mounting_deg)
    turned = np.zeros((6, 6))
    for i, share in enumerate((grade.scale[1], grade.scale[0])):
        distorted = np.eye(3) + imu.distortion * share * generator.standard_normal((3, 3))
        turned[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = distorted @ mounting(*angles * DEG).T
    return SensorConstants(
        turned,
        bias,
        six(grade.per_c) * generator.standard_normal(6),
        imu.temperature_change_c,
        imu.warm_up_s,
        imu.noise * six(grade.noise) * np.sqrt(0.5 / STEP_S),
        imu.noise * six(grade.wander),
        six(grade.span),
        six(grade.step),
        _resonators(),
        imu.vibration,
        1.0 / (np.pi * wheel_diameter_m),
    )


def mounting(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Floats:
    """Rotation (3, 3) that turns sensor axes into body axes; right-handed about x, then y, then z."""
    cr, sr, cp, sp = np.cos(roll_rad), np.sin(roll_rad), np.cos(pitch_rad), np.sin(pitch_rad)
    cy, sy = np.cos(yaw_rad), np.sin(yaw_rad)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(about_z @ about_y @ about_x)


def _resonators() -> Floats:
    """Two-pole filters y = a1 y' + a2 y'' + b w of unit variance under white noise."""
    rows = []
    for axis, hz, damping, sigma in MODES:
        omega = 2.0 * np.pi * hz * STEP_S
        r = np.exp(-damping * omega)
        a1, a2 = 2.0 * r * np.cos(omega * np.sqrt(1.0 - damping**2)), -r * r
        # Variance of an AR(2) process driven by unit noise (Box and Jenkins, 3.2.4).
        variance = (1.0 - a2) / ((1.0 + a2) * ((1.0 - a2) ** 2 - a1**2))
        rows.append((axis, a1, a2, 1.0 / np.sqrt(variance), sigma))
    return np.array(rows)


@kernel
def sense(
    time_s: float, wheel_way_m: float, speed_mps: float, c: SensorConstants, memory: Floats, noise: Floats, out: Floats
) -> None:
    """Turn what a perfect sensor feels, in `out` (6,), into what this one reads.

    `memory` (6 + 2k,) holds wandering biases and resonators; `noise` has NOISES normals.
    """
    felt = out.copy()
    warm = c.warm_c * (1.0 - np.exp(-time_s / c.warm_up_s))
    keep = 1.0 - STEP_S / DRIFT_S
    stir = np.sqrt(2.0 * STEP_S / DRIFT_S)
    lively = c.vibration * (IDLE + speed_mps / AT_MPS)
    turns = 2.0 * np.pi * wheel_way_m * c.revolutions_per_m
    uneven = c.vibration * (speed_mps / AT_MPS) ** 2
    for i in range(3):
        felt[i] += uneven * ROUND_MPS2[i] * np.sin(turns + i)
    for k in range(len(c.modes)):
        axis, a1, a2, gain, sigma = c.modes[k]
        value = a1 * memory[6 + 2 * k] + a2 * memory[7 + 2 * k] + gain * noise[12 + k]
        memory[7 + 2 * k] = memory[6 + 2 * k]
        memory[6 + 2 * k] = value
        felt[int(axis)] += lively * sigma * value
    for i in range(6):
        total = c.bias[i] + c.per_c[i] * warm
        for j in range(6):
            total += c.turned[i, j] * felt[j]
        memory[i] = keep * memory[i] + stir * c.wander[i] * noise[6 + i]
        total += memory[i] + c.white[i] * noise[i]
        total = min(max(total, -c.span[i]), c.span[i])
        out[i] = np.round(total / c.least[i]) * c.least[i]
