"""Logs that begin with a wheel that stands: in a train at rest, a humming one, and one whose wheels are locked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from services.odometry_fusion.first_rest import UNVOUCHED
from services.odometry_fusion.log_rest import WIDE, joined
from services.odometry_fusion.methods import begin, run_log, run_parts
from services.odometry_fusion.motion_log import DEGRADED, VALID, MotionLog, MotionRows, SixAxes, columns_of
from services.odometry_fusion.settings import Config
from tests.unit.odometry_fusion.test_odd_logs import begun_at, held
from tests.unit.odometry_fusion.test_paper_runs import CONFIG, errors_of, run_of

BEGUN_S = 45.0
"""At 18 m/s."""
UNDER_WAY = np.array([0.15] * 3 + [0.0015] * 3)


def shaken(log: MotionLog, first_s: float, end_s: float) -> SixAxes:
    """The log's inertial samples with those of a stretch shaken, as by the track."""
    inside = ((log.imu_t_s >= first_s) & (log.imu_t_s < end_s))[:, None]
    found: SixAxes = log.imu + inside * np.random.default_rng(5).normal(0.0, 1.0, log.imu.shape) * UNDER_WAY
    return found


def plain(log: MotionLog) -> MotionRows:
    step = begin(log.vehicle, CONFIG)
    return step.advance(log.end_s, log.imu_t_s, log.imu, log.tacho_t_s, log.pulses)


def locked(end_s: float) -> tuple[MotionLog, MotionRows]:
    """A log that begins under way, with a wheel that is locked until `end_s`."""
    log, t_s, distance_m = run_of()
    log = begun_at(replace(log, imu=shaken(log, 0.0, 123.0)), BEGUN_S)
    after = log.tacho_t_s >= end_s
    still = log.pulses[np.flatnonzero(after)[0]] if after.any() else log.pulses[-1]
    log = replace(log, pulses=np.maximum(log.pulses, still))
    rows = run_log(log, CONFIG)
    assert held(rows, t_s, distance_m)
    return log, rows


@pytest.mark.parametrize("shaken_s", [0.0, 5.0, 11.0])
def test_a_noisy_rest_changes_nothing(shaken_s: float) -> None:
    log, _, _ = run_of(slip_mps=4.0)
    # A log may begin with people who get on, or hum until it departs at 10 s.
    humming = replace(log, imu=shaken(log, 0.0, shaken_s))
    wanted, found = plain(humming), run_log(humming, CONFIG)
    for name, column in columns_of(wanted).items():
        np.testing.assert_array_equal(columns_of(found)[name], column, name)
    assert found.status.max() == VALID


def test_a_wheel_that_is_released_begins_anew_and_the_bound_holds_all_the_while() -> None:
    log, rows = locked(60.0)
    assert (rows.status[rows.t_s < 60.0] == DEGRADED).all()
    assert rows.reasons[rows.reason[5]] == UNVOUCHED
    # 15 s at 18 m/s have gone unseen, so that nothing is near until something else tells the place: all stays degraded.
    assert (rows.status == DEGRADED).all()
    assert rows.reasons[rows.reason[-1]] == WIDE
    assert (np.diff(rows.t_s) > 0.0).all()
    assert (np.diff(rows.excess_m) >= 0.0).all()
    parts = run_parts(log, CONFIG)
    assert len(parts) == 2
    # What counts from the release on is as good as that of any log that begins under way.
    _, t_s, distance_m = run_of()
    assert held(parts[1], t_s, distance_m)
    # 3.5 % of 1.0 km, and what slips may have cost until the wheel was seen to adhere.
    assert parts[1].bound_m[-1] < 60.0
    assert parts[1].status[-1] == VALID
    both = joined(parts)
    assert both.distance_m[-1] == pytest.approx(parts[0].distance_m[-1] + parts[1].distance_m[-1])


def test_a_wheel_that_stays_locked_until_the_train_stands_is_not_vouched_for() -> None:
    _, rows = locked(200.0)
    # Quiet since 123 s.
    assert (rows.status[rows.t_s < 120.0] == DEGRADED).all()
    assert rows.bound_m[-1] > 1_000.0


def test_without_an_inertial_sensor_that_is_looked_at_nothing_is_doubted() -> None:
    log, t_s, distance_m = run_of()
    begun = begun_at(replace(log, imu=shaken(log, 0.0, 123.0), pulses=np.zeros_like(log.pulses)), BEGUN_S)
    rows = run_log(begun, Config(method="wheel"))
    assert rows.status.max() == VALID
    assert np.max(np.abs(errors_of(rows, t_s, distance_m))) > 1_000.0
