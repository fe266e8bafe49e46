"""What the paper's method vouches for while nothing has decided yet between wheel and inertial sensor."""

from __future__ import annotations

import numpy as np
import pytest

from services.odometry_fusion.methods import run_log
from services.odometry_fusion.motion_log import VALID, Floats, MotionLog, MotionRows
from services.odometry_fusion.settings import Config

G = 9.80665
STEP_S = 0.01
CONFIG = Config(method="paper")
PULSE_M = np.pi * 0.816 / 90.0


def run_of(slip_t_s: list[float], slip_mps: list[float], *, steep: float = 0.0, off_mps2: float = 0.0) -> MotionLog:
    """150 s: at rest for 10 s, to 18 m/s by 40 s, on; the wheel turns faster by `slip_mps` (interpolated).

    From 60 s to 80 s the track comes to rise by `steep`; the accelerometer is off by `off_mps2`.
    """
    t_s, forward_mps2, _ = motion()
    pitch = np.interp(t_s, [60.0, 80.0], [0.0, steep])
    zero = np.zeros(len(t_s))
    imu = np.column_stack([
        forward_mps2 + G * np.sin(pitch) + off_mps2, zero, np.full(len(t_s), G), zero, -np.gradient(pitch, STEP_S), zero
    ])  # fmt: skip
    imu += np.random.default_rng(2).normal(0.0, 1.0, imu.shape) * np.array([0.05] * 3 + [0.0008] * 3)
    late = 30
    imu = np.vstack([np.repeat(imu[:1], late, axis=0), imu[:-late]])
    at = slice(9, None, 10)
    speed_mps = np.cumsum(forward_mps2) * STEP_S + np.interp(t_s, slip_t_s, slip_mps)
    pulses = np.floor(np.cumsum(speed_mps) * STEP_S / PULSE_M)[at].astype(np.int64)
    return MotionLog(t_s, imu, t_s[at], pulses, 90.0, 0.816, 0.3, 35.0)


def motion() -> tuple[Floats, Floats, Floats]:
    """Times, accelerations and distances of the train."""
    t_s = np.arange(0.0, 150.0, STEP_S)
    forward_mps2 = np.interp(t_s, [10, 11, 39, 40], [0, 0.62, 0.62, 0])
    return t_s, forward_mps2, np.cumsum(np.cumsum(forward_mps2)) * STEP_S * STEP_S


def errors_of(rows: MotionRows) -> Floats:
    t_s, _, distance_m = motion()
    error_m: Floats = np.abs(rows.distance_m - rows.distance_m[0] - np.interp(rows.t_s, t_s, distance_m))
    return error_m


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_slip_that_is_only_seen_when_it_ends_stays_within_the_bound(sign: float) -> None:
    # It builds up at 0.12 m/s², a third of Ta, and ends within half a second: that is what equation (1) sees.
    for start_s in (16.0, 20.0, 50.0):
        log = run_of([start_s, start_s + 14.0, start_s + 14.5], [0.0, sign * 1.7, 0.0])
        rows = run_log(log, CONFIG)
        assert any(one.phase == "began" for one in rows.episodes)
        assert (errors_of(rows) <= rows.bound_m).all()


def test_a_steep_line_and_an_accelerometer_that_is_off_are_no_slip() -> None:
    # 33 per mille and 0.15 m/s² come to 0.47 m/s², above Ta of 0.446: the gyro has seen the gradient come.
    rows = run_log(run_of([0.0], [0.0], steep=0.033, off_mps2=0.15), CONFIG)
    assert not rows.slip.any()
    assert not rows.episodes
    assert set(rows.status.tolist()) == {VALID}


def test_a_slip_on_such_a_line_is_found_all_the_same() -> None:
    rows = run_log(run_of([100.0, 101.0, 105.0, 106.0], [0.0, -4.0, -4.0, 0.0], steep=0.033, off_mps2=0.15), CONFIG)
    assert rows.slip[(rows.t_s > 103.0) & (rows.t_s < 105.0)].all()
    # Its end is not: accelerations go on to differ by more than Ta. A stop is demanded, and the bound tells.
    assert any(one.stop_demanded for one in rows.episodes)
    assert (errors_of(rows) <= rows.bound_m).all()


def test_a_slip_that_goes_on_after_a_lull_costs_no_more_than_the_bound() -> None:
    # In the lull wheel and inertial sensor agree for so long that re-adhesion is found; then it slips on.
    log = run_of([70.0, 71.0, 74.0, 75.0, 79.0, 80.0, 84.0, 84.3], [0.0, -5.0, -5.0, -0.3, -0.3, -4.0, -4.0, 0.0])
    rows = run_log(log, CONFIG)
    assert (errors_of(rows) <= rows.bound_m).all()
    assert errors_of(rows)[-1] < 10.0  # 37 m were lost
    # Taking an end back must not charge the bound twice: it is the same correction.
    assert (np.diff(rows.excess_m) >= 0.0).all()
    assert rows.excess_m[-1] < 20.0
