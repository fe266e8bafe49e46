from __future__ import annotations

import msgspec
import numpy as np
import pytest

from services.simulator.inertial_sensor import DEG, GRADES, MILLI_G, NOISES, drawn_sensor, mounting, sense
from services.simulator.motion_settings import Imu
from services.simulator.motion_state import STEP_S
from tests.unit.simulator.motion_tracks import PERFECT

TRUE = np.array([0.5, -0.2, 9.8, 0.01, -0.02, 0.03])


def read(
    imu: Imu, count: int = 20_000, speed_mps: float = 0.0, seed: int = 2
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    generator = np.random.default_rng(seed)
    sensor = drawn_sensor(imu, 0.816, generator)
    memory, noise = np.zeros(6 + 2 * len(sensor.modes)), generator.standard_normal((count, NOISES))
    out = np.tile(TRUE, (count, 1))
    for k in range(count):
        sense(k * STEP_S, k * STEP_S * speed_mps, speed_mps, sensor, memory, noise[k], out[k])
    return out


def test_a_perfect_sensor_reads_the_truth_to_its_last_digit() -> None:
    assert read(PERFECT, 10) == pytest.approx(np.tile(TRUE, (10, 1)), abs=1e-7)


@pytest.mark.parametrize("grade", ["adis16480", "mems"])
def test_noise_has_the_density_of_the_data_sheet(grade: str) -> None:
    imu = msgspec.structs.replace(PERFECT, noise=1.0, grade=grade)
    samples = read(imu)
    fast = np.diff(samples, axis=0).std(axis=0) / np.sqrt(2.0)
    figures = GRADES[grade].noise
    # 50 Hz of bandwidth at 100 Hz; differences take the bias's wander away. 20,000 samples: to 1 %.
    assert fast[3:] == pytest.approx(np.full(3, figures[0] * np.sqrt(50.0)), rel=0.03)
    assert fast[:3] == pytest.approx(np.full(3, figures[1] * np.sqrt(50.0)), rel=0.03)


def test_residual_biases_are_as_large_as_asked_for() -> None:
    imu = msgspec.structs.replace(PERFECT, gyro_bias_dps=0.05, accelerometer_bias_mps2=0.1)
    off = read(imu, 10).mean(axis=0) - TRUE
    assert np.abs(off) == pytest.approx([0.1] * 3 + [0.05 * DEG] * 3, abs=1e-7)


def test_bias_drifts_as_the_sensor_warms_up() -> None:
    imu = msgspec.structs.replace(PERFECT, temperature_change_c=10.0, warm_up_s=50.0)
    samples = read(imu)
    moved = samples[-1] - samples[0]
    # After four time constants 98 % of 10 K times the drawn coefficient; the spread is 0.0025 deg/s and 0.1 mg per K.
    assert np.all(np.abs(moved) > 0.0)
    assert np.abs(moved[3:]).max() < 10.0 * 4 * 0.0025 * DEG
    assert np.abs(moved[:3]).max() < 10.0 * 4 * 0.1 * MILLI_G


def test_a_sensor_mounted_askew_shows_gravity_on_other_axes() -> None:
    samples = read(msgspec.structs.replace(PERFECT, mounting_deg=(0.0, 1.0, 0.0)), 5)
    # Pitched by +1 degree about the left axis (nose down): gravity shows backwards.
    assert samples[0, 0] == pytest.approx(0.5 * np.cos(DEG) - 9.8 * np.sin(DEG), abs=1e-6)
    assert np.linalg.norm(samples[0, :3]) == pytest.approx(np.linalg.norm(TRUE[:3]), abs=1e-6)


def test_mounting_angles_make_a_rotation() -> None:
    turned = mounting(0.1, -0.2, 0.3)
    assert turned @ turned.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(turned) == pytest.approx(1.0)
    assert mounting(0.0, 0.0, np.pi / 2) @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)


def test_vibration_grows_with_speed_and_hardly_lives_at_rest() -> None:
    imu = msgspec.structs.replace(PERFECT, vibration=1.0)
    rest, slow, fast = (read(imu, 20_000, speed).std(axis=0) for speed in (0.0, 10.0, 20.0))
    assert np.all(rest < 0.05 * fast)
    assert slow[1] == pytest.approx(fast[1] / 2, rel=0.1)
    assert read(msgspec.structs.replace(imu, vibration=2.0), 20_000, 20.0).std(axis=0) == pytest.approx(2 * fast)
    # The modes of the vertical axis are 0.06, 0.16 and 0.28, the wheel's 0.08/sqrt(2), at 20 m/s.
    assert fast[2] == pytest.approx(np.sqrt(0.06**2 + 0.16**2 + 0.28**2 + 0.08**2 / 2) * 1.01, rel=0.08)


def test_readings_end_at_the_span() -> None:
    generator = np.random.default_rng(1)
    sensor = drawn_sensor(PERFECT, 0.816, generator)
    out = np.array([200.0, -200.0, 9.8, 20.0, -20.0, 0.0])
    sense(0.0, 0.0, 0.0, sensor, np.zeros(6 + 2 * len(sensor.modes)), np.zeros(NOISES), out)
    span = GRADES["adis16480"].span
    assert out == pytest.approx([span[1], -span[1], 9.8, span[0], -span[0], 0.0], abs=1e-6)
