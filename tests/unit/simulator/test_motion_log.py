from __future__ import annotations

import numpy as np
import pytest

from services.simulator.motion_log import MotionLog, simulate_motion_log, slip_runs
from services.simulator.motion_settings import CONVENTIONAL, IDLE_AXLE, Imu, MotionSettings, Tacho
from services.simulator.random_track import TrackSettings, random_track
from tests.unit.simulator.motion_tracks import IDEAL, uniform_track

TRACK = TrackSettings(length_m=8000.0, max_gradient_permille=33.0)


def log_of(settings: MotionSettings, seed: int = 4, duration_s: float = 500.0) -> MotionLog:
    generator = np.random.default_rng(seed)
    return simulate_motion_log(random_track(TRACK, generator), settings, generator, duration_s=duration_s)


def test_a_log_has_100_hz_10_hz_and_no_holes() -> None:
    log = log_of(MotionSettings())
    assert log.imu.shape == (50_000, 6)
    assert log.imu_t_s[[0, -1]] == pytest.approx([0.01, 500.0])
    assert log.tacho_t_s == pytest.approx(np.arange(0.1, 500.05, 0.1))
    assert np.array_equal(log.truth_t_s, log.tacho_t_s)
    assert np.isfinite(log.imu).all()


def test_what_a_perfect_sensor_feels_integrates_to_the_train_s_speed() -> None:
    log = log_of(IDEAL)
    # Pitch by equation (4) of Iwata et al. with (5) for the roll, both from the true start at rest.
    rest = log.imu[:100].mean(axis=0)
    pitch, roll = float(np.arcsin(rest[0] / 9.80665)), float(np.arctan2(rest[1], rest[2]))
    speed = np.zeros(len(log.imu))
    for k in range(1, len(log.imu)):
        ax, gx, gy, gz = log.imu[k, [0, 3, 4, 5]]
        roll += (gx - gz * np.sin(pitch)) * 0.01
        pitch += (-gy * np.cos(roll) + gz * np.sin(roll)) * 0.01
        speed[k] = speed[k - 1] + (ax - 9.80665 * np.sin(pitch)) * 0.01
    # Open loop over 500 s; steps of 10 ms in attitude leave some 1e-5 rad, and each stop's jolt some mm/s.
    error = speed[9::10] - log.speed_mps
    assert np.abs(error).max() < 0.35
    assert np.abs(error[:600]).max() < 0.05


def test_counts_follow_the_train_when_it_is_dry() -> None:
    log = log_of(MotionSettings(tacho=Tacho(wheel_scale=0.0)))
    way_m = (log.pulses - log.pulses[0]) * np.pi * log.wheel_diameter_m / log.pulses_per_revolution
    # Micro-slip alone is between: some per mille of the way, and one tooth.
    assert np.all(np.abs(way_m - (log.distance_m - log.distance_m[0])) < 0.01 * log.distance_m + 0.04)


def test_a_late_sensor_shows_what_was_before() -> None:
    early, late = (log_of(MotionSettings(imu=Imu(latency_s=delay_s))) for delay_s in (0.0, 0.3))
    # The late log starts when the first sample has arrived, 0.3 s on.
    assert np.array_equal(late.imu[:40_000], early.imu[:40_000])
    assert late.speed_mps[:4000] == pytest.approx(
        np.interp(late.truth_t_s + 0.3, early.truth_t_s, early.speed_mps)[:4000], abs=0.01
    )


def test_a_run_without_a_duration_ends_at_the_last_stop() -> None:
    log = simulate_motion_log(uniform_track(), IDEAL, np.random.default_rng(1))
    assert log.speed_mps[-1] == 0.0
    assert log.way_m[-1] == pytest.approx(5800.0, abs=2.6)
    assert log.trip.max() == 0


def test_runs_depend_on_the_seed_and_their_number_alone() -> None:
    first = list(slip_runs(7, 12, track=TRACK, duration_s=400.0))
    again = list(slip_runs(7, 4, track=TRACK, duration_s=400.0))
    assert sum(log.slips for log in first) >= 12
    assert len(again) < len(first)
    for one, other in zip(first, again, strict=False):
        assert np.array_equal(one.imu, other.imu)
        assert np.array_equal(one.pulses, other.pulses)
        assert np.array_equal(one.slip, other.slip)
    assert not np.array_equal(first[0].imu, first[1].imu)
    assert not np.array_equal(next(slip_runs(8, 1, track=TRACK, duration_s=400.0)).imu, first[0].imu)


def test_settings_that_allow_no_slip_are_told() -> None:
    with pytest.raises(ValueError, match="without a slip"):
        list(slip_runs(1, 5, MotionSettings(vehicle=IDLE_AXLE), TRACK, duration_s=60.0))


def test_wheel_scale_shows_in_the_counts() -> None:
    small, nominal = (log_of(MotionSettings(tacho=Tacho(wheel_scale=scale))) for scale in (-0.01, 0.0))
    assert small.pulses[-1] / nominal.pulses[-1] == pytest.approx(1 / 0.99, rel=1e-4)
    assert small.true_wheel_diameter_m == pytest.approx(0.99 * CONVENTIONAL.wheel_diameter_m)
