"""Logs that are not as they should be: jittering stamps, a pulse per row, a begin in full run or in a slip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from services.odometry_fusion.even_stamps import GRID, even_times
from services.odometry_fusion.methods import run_log
from services.odometry_fusion.motion_log import DEGRADED, VALID, Floats, MotionLog, MotionRows
from services.odometry_fusion.paper_layout import FRESH, JITTERING
from services.odometry_fusion.paper_settings import PaperSettings
from services.odometry_fusion.settings import Config
from tests.unit.odometry_fusion.test_paper_runs import CONFIG, errors_of, run_of

PULSE_M = np.pi * 0.816 / 90.0


def begun_at(log: MotionLog, first_s: float) -> MotionLog:
    """The log as if it had been switched on at `first_s`."""
    imu, tacho = log.imu_t_s >= first_s, log.tacho_t_s >= first_s
    return replace(
        log,
        imu_t_s=log.imu_t_s[imu],
        imu=np.ascontiguousarray(log.imu[imu]),
        tacho_t_s=log.tacho_t_s[tacho],
        pulses=log.pulses[tacho],
    )


def jittered(log: MotionLog, sigma_s: float) -> MotionLog:
    """The same counts, stamped unevenly."""
    t_s = np.sort(log.tacho_t_s + np.random.default_rng(3).normal(0.0, sigma_s, len(log.tacho_t_s)))
    return replace(log, tacho_t_s=np.maximum(t_s, 0.0) + 1e-6 * np.arange(len(t_s)))


def held(rows: MotionRows, t_s: Floats, distance_m: Floats) -> bool:
    return bool((np.abs(errors_of(rows, t_s, distance_m)) <= rows.bound_m).all())


@pytest.mark.parametrize("slip_mps", [0.0, 4.0])
@pytest.mark.parametrize("first_s", [25.0, 45.0, 60.0])
def test_a_log_that_begins_in_full_run_is_followed(first_s: float, slip_mps: float) -> None:
    log, t_s, distance_m = run_of(slip_mps=slip_mps, gradient=0.01)
    rows = run_log(begun_at(log, first_s), CONFIG)
    assert held(rows, t_s, distance_m)
    # With a slip from 70 s on as without one: 2 m as in the tests of whole logs, and the wheel until it is trusted.
    if slip_mps == 0.0 or first_s < 50.0:
        assert abs(errors_of(rows, t_s, distance_m)[-1]) < 4.0
    assert rows.reason[5] == FRESH
    assert rows.status[5] == DEGRADED
    if slip_mps == 0.0:
        assert not rows.episodes
        assert rows.status[rows.t_s > first_s + 20.0].max() == VALID


@pytest.mark.parametrize("first_s", [71.0, 73.0, 75.0])
def test_a_log_that_begins_in_a_slip_says_how_much_it_may_have_missed(first_s: float) -> None:
    log, t_s, distance_m = run_of(slip_mps=4.0)
    rows = run_log(begun_at(log, first_s), CONFIG)
    assert held(rows, t_s, distance_m)
    assert rows.reason[10] == FRESH


@pytest.mark.parametrize("sigma_s", [0.002, 0.008, 0.015])
def test_stamps_that_jitter_are_put_on_their_grid(sigma_s: float) -> None:
    log, t_s, distance_m = run_of(slip_mps=4.0)
    rows = run_log(jittered(log, sigma_s), CONFIG)
    assert held(rows, t_s, distance_m)
    # As with even stamps: one slip, corrected to 3 m.
    assert [one.phase for one in rows.episodes] == ["began", "ended"]
    assert abs(errors_of(rows, t_s, distance_m)[-1]) < 3.0
    assert rows.status.max() == VALID


def test_counts_that_truly_come_unevenly_widen_the_thresholds() -> None:
    log, t_s, distance_m = run_of(slip_mps=4.0)
    # Every reading a different time too late, and every other one left out at random: there is no grid.
    rng = np.random.default_rng(5)
    kept = np.sort(rng.choice(len(log.tacho_t_s), len(log.tacho_t_s) // 2, replace=False))
    uneven = jittered(replace(log, tacho_t_s=log.tacho_t_s[kept], pulses=log.pulses[kept]), 0.008)
    rows = run_log(uneven, CONFIG)
    assert held(rows, t_s, distance_m)
    assert (rows.reason == JITTERING).any()
    plain = run_log(uneven, Config(method="paper", paper=PaperSettings(watches_stamps=False)))
    assert not (plain.reason == JITTERING).any()
    assert rows.bound_m[-1] > plain.bound_m[-1]


@pytest.mark.parametrize("stated_s", [0.0, 0.2, 0.4, 0.6])
def test_a_latency_stated_wrongly_stays_within_the_bound(stated_s: float) -> None:
    log, t_s, distance_m = run_of(slip_mps=4.0, gradient=0.02)
    assert held(run_log(replace(log, imu_latency_s=stated_s), CONFIG), t_s, distance_m)


@pytest.mark.parametrize("scale", [0.98, 1.02])
def test_a_wheel_that_is_off_by_two_percent_stays_within_the_bound(scale: float) -> None:
    log, t_s, distance_m = run_of(slip_mps=4.0)
    rows = run_log(replace(log, wheel_diameter_m=log.wheel_diameter_m * scale), CONFIG)
    assert held(rows, t_s, distance_m)
    # A correction of 20 s may leave it open whether wheel or inertial sensor is right, and says so.
    assert rows.status[rows.slip == 0].max() == VALID


@pytest.mark.parametrize("teeth", [1, 8])
def test_a_counter_that_reports_pulse_by_pulse_is_silent_at_rest_only(teeth: int) -> None:
    log, t_s, distance_m = run_of(slip_mps=4.0)
    way = np.maximum.accumulate(log.pulses / teeth) + 1e-9 * np.arange(len(log.pulses))
    counts = np.arange(0, int(way[-1]) + 1)
    times_s = np.interp(counts, way, log.tacho_t_s)
    one_by_one = replace(log, tacho_t_s=times_s, pulses=counts, pulses_per_revolution=90.0 / teeth)
    rows = run_log(one_by_one, CONFIG)
    within = rows.t_s < 149.0
    error_m = errors_of(rows, t_s, distance_m)
    assert (np.abs(error_m) <= rows.bound_m)[within].all()
    assert abs(error_m[-1]) < 3.0
    assert rows.status.max() == VALID
    assert [one.phase for one in rows.episodes] == ["began", "ended"]
    wheel = run_log(one_by_one, Config(method="wheel"))
    assert wheel.status.max() == VALID
    assert wheel.standstill[(wheel.t_s > 4.0) & (wheel.t_s < 9.0)].all()
    assert (np.abs(errors_of(wheel, t_s, distance_m)) <= wheel.bound_m)[within].all()


def grid_of(t_s: Floats, way_m: Floats) -> Floats:
    even_ns = np.empty(len(t_s), np.int64)
    even_times(np.rint(t_s * 1e9).astype(np.int64), way_m, np.zeros(1, GRID), even_ns)
    return even_ns / 1e9


def test_even_stamps_and_true_uneven_ones_stay_as_they_are() -> None:
    even_s: Floats = 0.1 * np.arange(1.0, 600.0)
    assert np.array_equal(grid_of(even_s, 20.0 * even_s), even_s.round(9))
    uneven_s = np.sort(even_s + np.random.default_rng(1).normal(0.0, 0.008, len(even_s)))
    # The way is that of the stamps: they tell the truth.
    assert np.allclose(grid_of(uneven_s, 20.0 * uneven_s), uneven_s, rtol=0.0, atol=1e-8)


def test_the_grid_takes_jitter_off_and_survives_missing_and_outlying_counts() -> None:
    rng = np.random.default_rng(2)
    true_s: Floats = np.delete(0.1 * np.arange(1.0, 2000.0), [700, 701, 702, 1100]).astype(np.float64)
    stamped_s = true_s + rng.normal(0.0, 0.008, len(true_s))
    stamped_s[1500] += 0.06
    found_s = grid_of(stamped_s, 20.0 * true_s)
    assert (np.diff(found_s) > 0.0).all()
    # A mean over some fifty stamps of 8 ms is good to 8 ms / √25.
    assert np.abs(found_s - true_s)[100:].max() < 0.005


def test_a_counter_made_of_a_noisy_speed_and_biased_gyros_still_show_a_standstill() -> None:
    log, t_s, distance_m = run_of(slip_mps=4.0)
    rng = np.random.default_rng(4)
    # 5 mm/s of noise in the speed, as of a gyro on the wheel; 1 °/s of bias, as of a cheap sensor.
    way_m = log.pulses * PULSE_M + np.cumsum(rng.normal(0.0, 0.005, len(log.pulses))) * 0.1
    fine = replace(
        log,
        pulses=np.rint(way_m * 1e4 / (np.pi * 0.6)).astype(np.int64),
        pulses_per_revolution=1e4,
        wheel_diameter_m=0.6,
        imu=log.imu + np.array([0.0, 0.0, 0.0, -0.017, 0.017, 0.0]),
    )
    rows = run_log(fine, CONFIG)
    assert rows.standstill[(rows.t_s > 4.0) & (rows.t_s < 9.0)].all()
    assert held(rows, t_s, distance_m)
    assert abs(errors_of(rows, t_s, distance_m)[-1]) < 3.0
