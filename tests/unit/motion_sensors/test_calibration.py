from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from services.motion_sensors.calibrated_log_file import calibrated
from services.motion_sensors.calibration import calibrate, gradient_threshold_kmhps
from services.motion_sensors.imu_sample import STANDARD_GRAVITY_MPS2 as G
from services.motion_sensors.mounting import angles_rotation
from services.odometry_fusion.motion_log import MotionLog

DIAMETER_M, TEETH = 0.81, 90.0


def run(  # four stops on level track, then away again
    latency_s: float, roll_deg: float = 0.0, pitch_deg: float = 0.0, yaw_deg: float = 0.0, *, nominal_m: float = 0.816
) -> tuple[MotionLog, float]:
    """A log in closed form, and its true length [m]: 0.8 m/s² up to 16 m/s, held, 0.8 m/s² down, 20 s at rest."""
    t = np.arange(0.0, 600.0, 0.01)
    beat = t % 150.0
    acceleration = np.where((beat >= 20) & (beat < 40), 0.8, np.where((beat >= 110) & (beat < 130), -0.8, 0.0))
    speed = np.cumsum(acceleration) * 0.01
    distance = np.cumsum(speed) * 0.01
    vehicle = np.stack([acceleration, np.zeros_like(t), np.full_like(t, G)], axis=1)
    sensor = vehicle @ angles_rotation(*np.radians([roll_deg, pitch_deg, yaw_deg]))
    noise = np.random.default_rng(1).normal(0.0, 0.02, (len(t), 6))
    imu = np.concatenate([sensor, np.zeros((len(t), 3))], axis=1) + noise
    tacho_t = np.arange(0.05, 599.0, 0.1)
    pulses = np.floor(np.interp(tacho_t, t, distance) / (np.pi * DIAMETER_M) * TEETH).astype(np.int64)
    log = MotionLog(t + latency_s, imu, tacho_t, pulses, TEETH, nominal_m, 0.0, 35.0)
    return log, float(np.interp(tacho_t[-1], t, distance) - np.interp(tacho_t[0], t, distance))


@pytest.mark.parametrize("latency_s", [0.0, 0.13, 0.3, 0.9])
def test_the_delay_between_the_sensors_is_found(latency_s: float) -> None:
    found = calibrate([run(latency_s)[0]]).latency_s
    # A tenth of the pulse counter's period; the ramps of acceleration are infinitely steep here.
    assert found.value == pytest.approx(latency_s, abs=0.02)
    assert found.stretches >= 3


def test_mounting_angles_are_found_and_taken_back_by_the_same_rotation() -> None:
    found = calibrate([run(0.3, roll_deg=1.0, pitch_deg=-0.7, yaw_deg=2.0)[0]])
    assert found.roll_deg.value == pytest.approx(1.0, abs=0.05)
    assert found.pitch_deg.value == pytest.approx(-0.7, abs=0.05)
    # Noise of the acceleration across over that along: 2 % of 0.8 m/s² over many samples.
    assert found.yaw_deg.value == pytest.approx(2.0, abs=0.3)


def test_a_known_distance_gives_the_wheel() -> None:
    log, length_m = run(0.0)
    found = calibrate([log, log], [length_m, length_m]).wheel_diameter_m
    assert found.value == pytest.approx(DIAMETER_M, rel=1e-4)
    assert not calibrate([log]).wheel_diameter_m.known


def test_ordinary_differences_set_the_threshold() -> None:
    level = calibrate([run(0.2)[0]]).threshold_kmhps.value
    assert 0.0 < level < 0.6
    assert gradient_threshold_kmhps(35.0) == pytest.approx(1.2356, abs=1e-4)


def moving_part(log: MotionLog) -> MotionLog:
    part, tacho = slice(2500, 12_500), slice(260, 1240)
    return MotionLog(
        log.imu_t_s[part], log.imu[part], log.tacho_t_s[tacho], log.pulses[tacho], TEETH, DIAMETER_M, 0.0, 35.0
    )


def test_a_run_without_a_stop_gives_the_angles_of_a_level_way() -> None:
    found = calibrate([moving_part(run(0.0, roll_deg=1.0, pitch_deg=-0.7)[0])])
    # The ends of the ramps are smoothed differently in both: 0.8 m/s² for a second of a hundred.
    assert found.roll_deg.value == pytest.approx(1.0, abs=0.06)
    assert found.pitch_deg.value == pytest.approx(-0.7, abs=0.06)


def test_a_counter_that_creeps_at_rest_does_not_hide_the_stops() -> None:
    log, _ = run(0.0, roll_deg=1.0)
    pulse_m = np.pi * DIAMETER_M / TEETH
    fine = np.rint(log.pulses * 500.0 + 0.0005 / pulse_m * 500.0 * log.tacho_t_s).astype(np.int64)
    creeping = replace(log, pulses=fine, pulses_per_revolution=500.0 * TEETH)
    assert calibrate([creeping]).roll_deg.stretches == calibrate([log]).roll_deg.stretches


def test_a_calibrated_log_has_nothing_left_to_calibrate() -> None:
    log, length_m = run(0.3, roll_deg=1.0, pitch_deg=-0.7, yaw_deg=2.0)
    new = calibrated(log, calibrate([log], [length_m]))
    assert new.imu_latency_s == pytest.approx(0.3, abs=0.02)
    assert new.wheel_diameter_m == pytest.approx(DIAMETER_M, rel=1e-4)
    left = calibrate([new])
    assert abs(left.roll_deg.value) < 0.01
    assert abs(left.pitch_deg.value) < 0.01
    # The share of the force across that is noise is found again, within the yaw's own error.
    assert abs(left.yaw_deg.value) < 0.3


def test_a_snippet_is_refused() -> None:
    log, _ = run(0.0)
    short = MotionLog(log.imu_t_s[:500], log.imu[:500], log.tacho_t_s[:50], log.pulses[:50], TEETH, 0.8, 0.0, 35.0)
    with pytest.raises(ValueError, match="shorter than 40 s"):
        calibrate([short])
