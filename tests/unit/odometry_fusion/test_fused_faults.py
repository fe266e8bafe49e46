"""The fused mode when sensors are late, turned or wrong, or when it begins in a slip: told, and within its bound."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.odometry_faults import begun, error_of, late, turned
from schemas.motion import Odometry
from services.odometry_fusion.fused_gaps import bridge_gap, hidden_by_lateness
from services.odometry_fusion.fused_layout import (
    BRANCH,
    CONTRADICTED,
    LATE,
    NOW,
    ROOM,
    SIZE,
    TURNED,
    UNCONFIRMED,
    Branches,
    D,
    V,
    W,
)
from services.odometry_fusion.fused_odometry import FusedOdometry
from services.odometry_fusion.fused_origin import begin_branches, begin_now
from services.odometry_fusion.fused_settings import FusedSettings
from services.odometry_fusion.inertial_axes import watch_axes
from services.odometry_fusion.live_odometry import LiveOdometry
from services.odometry_fusion.motion_log import VALID, MotionRows
from services.odometry_fusion.motion_log import MotionLog as Samples
from services.odometry_fusion.settings import Config
from services.odometry_fusion.tick_layout import TICK, Records
from services.simulator.motion_log import MotionLog, simulate_motion_log, slip_runs
from services.simulator.motion_settings import MotionSettings
from services.simulator.random_track import TrackSettings, random_track
from tests.unit.odometry_fusion.test_shell_live import START_NS, blocks_of

RUN_S = 240.0
UNDER_WAY_S = 70.0
"""The train of `dry` runs at 15 m/s and more."""


@cache
def dry(seed: int = 2) -> MotionLog:
    """A run without slips, from rest."""
    generator = np.random.default_rng(seed)
    track = random_track(TrackSettings(length_m=8_000.0, max_gradient_permille=33.0), generator)
    return simulate_motion_log(track, MotionSettings(), generator, duration_s=RUN_S)


def run(log: MotionLog) -> MotionRows:
    wheel = (log.pulses_per_revolution, log.wheel_diameter_m, log.imu_latency_s, log.max_gradient_permille)
    samples = Samples(log.imu_t_s, np.ascontiguousarray(log.imu), log.tacho_t_s, log.pulses, *wheel)
    step = FusedOdometry(samples.vehicle, FusedSettings())
    return step.advance(float(log.truth_t_s[-1]), samples.imu_t_s, samples.imu, samples.tacho_t_s, samples.pulses)


def require_held(log: MotionLog, rows: MotionRows, spare_m: float = 0.3) -> None:
    """Every row within its bound, and any two of them within what the message promises and `spare_m`.

    Counting teeth, and what the speed lags behind over the latency, are 0.3 m at both ends together.
    """
    error_m = error_of(log, rows)
    assert (np.abs(error_m) <= rows.bound_m).all()
    first, last = np.sort(np.random.default_rng(1).integers(0, len(rows), (2, 4000)), axis=0)
    promised_m = (
        rows.share_bound * (rows.way_m[last] - rows.way_m[first])
        + rows.excess_m[last]
        - rows.excess_m[first]
        + rows.provisional_m[first]
        + rows.provisional_m[last]
    )
    assert (np.abs(error_m[last] - error_m[first]) <= promised_m + spare_m).all()


@pytest.mark.parametrize("by_s", [1.0, 2.0, 5.0])
def test_stamps_of_both_late_alike_are_bounded_and_told(by_s: float) -> None:
    log = late(dry(), UNDER_WAY_S, by_s)
    rows = run(log)
    require_held(log, rows)
    after = rows.t_s > UNDER_WAY_S + by_s + 2.0
    assert (rows.status[after] != VALID).all()
    assert (rows.reason[after] == LATE).any()
    assert not rows.episodes


def test_both_late_with_right_stamps_is_only_waited_for() -> None:
    log, by_ns = dry(), 2_000_000_000
    wheel = (log.pulses_per_revolution, log.wheel_diameter_m, log.imu_latency_s, log.max_gradient_permille)
    samples = Samples(log.imu_t_s, np.ascontiguousarray(log.imu), log.tacho_t_s, log.pulses, *wheel)
    live = LiveOdometry(Config(imu_latency_s=log.imu_latency_s), "T1", 1, None)
    since_ns = START_NS + round(UNDER_WAY_S * 1e9)
    said = []
    waited = False
    for block, device in blocks_of(samples):
        if block.t_ns > since_ns and not waited:
            # What the service does while nothing comes for two seconds.
            waited = True
            for tenth in range(by_ns // 100_000_000):
                said += live.silent(0.1 * tenth)
        said += live.take(block, device)
    rows = [one for one in said if isinstance(one, Odometry)]
    assert (np.diff([one.t_ns for one in rows]) == 100_000_000).all()
    t_s = np.array([(one.t_ns - START_NS) * 1e-9 for one in rows])
    true_m = np.interp(t_s, log.truth_t_s, log.distance_m)
    error_m = np.array([one.distance_m for one in rows]) - (true_m - true_m[0])
    assert (np.abs(error_m) <= [one.bound_m for one in rows]).all()
    assert {one.status for one in rows} >= {"valid", "lost"}
    assert rows[-1].status == "valid"


@pytest.mark.parametrize("sense", [-1.0, 1.0])
def test_a_sensor_turned_before_the_departure_is_found_and_left_out(sense: float) -> None:
    log = turned(dry(), -1.0, sense)
    rows = run(log)
    # Until the spin shows, 2 s after the departure, the account that the wheels adhere gives way by 0.8 m.
    require_held(log, rows, 0.9)
    assert TURNED in rows.reason
    # Found within 15 s of the first departure; from then on it is the wheel's distance.
    found = int(np.flatnonzero(rows.reason == TURNED)[0])
    departed = int(np.flatnonzero(log.speed_mps > 0.5)[0])
    assert rows.t_s[found] - log.truth_t_s[departed] < 15.0
    assert (rows.status[found:] != VALID).all()
    # Nothing but wear and micro-slip is left: 2 % of the way.
    assert np.abs(error_of(log, rows)[-1]) < 0.02 * rows.way_m[-1]


@pytest.mark.parametrize("sense", [-1.0, 1.0])
def test_a_sensor_turned_under_way_is_bounded_and_told(sense: float) -> None:
    log = turned(dry(), UNDER_WAY_S, sense)
    rows = run(log)
    # Each new beginning with a wrong attitude costs some metres before it shows: 1.2 m in these runs.
    require_held(log, rows, 2.0)
    assert {TURNED, CONTRADICTED} & set(rows.reason.tolist())


def test_no_sensor_is_taken_for_turned_in_slips() -> None:
    log = next(slip_runs(3, 4, MotionSettings(), TrackSettings(max_gradient_permille=33.0), duration_s=900.0))
    assert not {TURNED, CONTRADICTED} & set(run(log).reason.tolist())


def test_begun_in_a_slip_it_does_not_vouch_for_the_wheels_speed() -> None:
    log = next(slip_runs(3, 4, MotionSettings(), TrackSettings(max_gradient_permille=33.0), duration_s=900.0))
    edges = np.flatnonzero((log.slip[1:] != 0) & (log.slip[:-1] == 0))
    # A second after slips have begun; a locked wheel looks like a train at rest and is another matter.
    starts_s = [float(log.truth_t_s[edge]) + 1.0 for edge in edges]
    held = 0
    for start_s in starts_s:
        part = begun(log, start_s)
        pulses = part.pulses[part.tacho_t_s < start_s + 2.0]
        if pulses[-1] - pulses[0] < 10 or start_s > 800.0:
            continue
        rows = run(part)
        # Two counts are needed for a speed.
        assert (rows.status[5:30] != VALID).all()
        assert (np.abs(error_of(log, rows)) <= rows.bound_m).all()
        held += 1
    assert held >= 3


def test_begun_in_full_run_it_is_confirmed_in_time() -> None:
    log = begun(dry(), UNDER_WAY_S)
    rows = run(log)
    require_held(log, rows)
    doubted = rows.reason == UNCONFIRMED
    assert doubted[5:80].all()
    # A slip lasts 4 s in the mean: after 40 s none that began before can be left.
    assert not doubted[400:].any()


def test_an_accelerometer_that_goes_wrong_does_not_keep_a_slip_alive() -> None:
    log = dry()
    imu = log.imu.copy()
    imu[log.imu_t_s > UNDER_WAY_S, 0] += 0.3
    wrong = replace(log, imu=imu)
    rows = run(wrong)
    assert (np.abs(error_of(log, rows)) <= rows.bound_m).all()
    assert rows.slip[-1] == 0


def fresh(speed_mps: float) -> tuple[Branches, Records]:
    now = np.zeros(1, NOW)
    begin_now(now[0])
    branches = Branches(np.zeros((ROOM, SIZE)), np.zeros((ROOM, SIZE, SIZE)), np.zeros(ROOM, BRANCH))
    begin_branches(branches, now[0], 0.0, 0.0, speed_mps)
    return branches, now


def test_counts_that_do_not_fit_after_a_gap_tie_the_rim_anew() -> None:
    branches, now = fresh(15.0)
    tick = np.zeros(1, TICK)
    now["gap_s"], now["both_ticks"], now["came_m"], tick["aligned_m"] = 1.9, 15, 1.5, 1.5
    branches.x[0, D] = branches.x[0, W] = 30.0
    bridge_gap(tick[0], now[0], branches, 1e-4, 0.1)
    # The next step takes W on to what is counted; way and speed of the train stay.
    assert branches.x[0, W] + 0.1 * 15.0 == pytest.approx(1.5)
    assert branches.x[0, D] == 30.0
    assert branches.x[0, V] == 15.0
    assert now["late_s"][0] == pytest.approx(2.0)
    assert hidden_by_lateness(now[0], 15.0) == 0.0
    assert hidden_by_lateness(now[0], 20.0) == pytest.approx(10.0)
    # The range counts: from 5 m/s above to 15 m/s below.
    assert hidden_by_lateness(now[0], 0.0) == pytest.approx(40.0)


def test_counts_that_fit_after_a_gap_are_left_alone() -> None:
    branches, now = fresh(15.0)
    tick = np.zeros(1, TICK)
    now["gap_s"], now["both_ticks"], now["came_m"], tick["aligned_m"] = 1.9, 15, 30.0, 31.5
    branches.x[0, D] = branches.x[0, W] = 30.0
    bridge_gap(tick[0], now[0], branches, 1e-4, 0.1)
    assert branches.x[0, W] == 30.0
    assert now["late_s"][0] == 0.0


@pytest.mark.parametrize(("sense", "expected"), [(1.0, True), (-1.0, True), (0.0, False)])
def test_a_turned_sensor_shows_the_wheels_acceleration_on_y(sense: float, *, expected: bool) -> None:
    now, tick, x = np.zeros(1, NOW), np.zeros(1, TICK), np.zeros(SIZE)
    now["wild_tick"], now["slip_share"] = -1000, 1.0
    found = False
    for k in range(400):
        # Speed 10 sin(0.2 t) + 10: accelerations of 2 m/s² at most, a period of half a minute.
        t_s = 0.1 * k
        now["tick"], now["rim_mps"] = k, 10.0 + 10.0 * np.sin(0.2 * t_s)
        force_mps2 = 2.0 * np.cos(0.2 * t_s)
        tick["ax_mps2"], tick["ay_mps2"] = (0.0, sense * force_mps2) if sense else (force_mps2, 0.0)
        found |= watch_axes(tick[0], now[0], x, 0.1)
    assert found is expected
