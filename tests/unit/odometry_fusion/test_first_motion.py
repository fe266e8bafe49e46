"""A wheel that turns when odometry begins: it adheres, or slips since before; live samples and logs."""

from __future__ import annotations

import numpy as np
import pytest

from schemas.motion import Odometry
from services.odometry_fusion.first_motion import CALM_S, UNSEEN, UNSEEN_M, FirstMotion
from services.odometry_fusion.first_rest import FASTEST_MPS
from services.odometry_fusion.live_odometry import LiveOdometry
from services.odometry_fusion.log_motion import first_slip
from services.odometry_fusion.methods import begin, run_log
from services.odometry_fusion.motion_log import DEGRADED, VALID, MotionLog, columns_of
from services.odometry_fusion.settings import Config
from tests.unit.odometry_fusion.test_odd_logs import begun_at, held
from tests.unit.odometry_fusion.test_paper_runs import run_of
from tests.unit.odometry_fusion.test_shell_live import START_NS, blocks_of

TICK_NS = 100_000_000
SPEED_MPS = 15.0
G = 9.80665
PULSE_M = 0.0285
SLIDING_S = 74.0
"""In the run of `run_of` the wheel slides by 4 m/s then, and returns from 76 to 78 s."""


class Train:
    """Samples of both sensors, a tenth of a second at a time: 100 Hz and 10 Hz."""

    def __init__(self) -> None:
        self.motion = FirstMotion(0.0)
        self.t_ns, self.way_m, self.pitch_rad = 0, 0.0, 0.0
        self._generator = np.random.default_rng(1)

    def run(
        self,
        seconds: float,
        rim_mps: float,
        *,
        gains_mps2: float = 0.0,
        climbs_radps: float = 0.0,
        shaken: float = 0.1,
        felt: bool = True,
    ) -> FirstMotion:
        """So long; the inertial sensor feels an acceleration on a gradient that changes evenly."""
        for _ in range(round(seconds * 10)):
            if self.motion.over:
                break
            t_ns = self.t_ns + np.arange(1, 11) * TICK_NS // 10
            self.pitch_rad += climbs_radps * 0.1
            imu = self._generator.normal(0.0, 1.0, (10, 6)) * shaken * np.array([1.0] * 3 + [0.01] * 3)
            imu[:, 0] += gains_mps2 + G * np.sin(self.pitch_rad)
            imu[:, 4] -= climbs_radps
            self.t_ns += TICK_NS
            self.way_m += rim_mps * 0.1
            turned_m = np.floor(self.way_m / PULSE_M) * PULSE_M
            empty = np.empty(0, np.int64)
            self.motion.take(
                t_ns if felt else empty,
                imu if felt else np.empty((0, 6)),
                np.array([self.t_ns]),
                np.array([turned_m]),
            )
        return self.motion


def test_a_wheel_that_agrees_for_longer_than_slips_last_adheres() -> None:
    train = Train()
    assert train.run(CALM_S - 1.0, SPEED_MPS, climbs_radps=0.002).settled_ns is None
    settled_ns = train.run(3.0, SPEED_MPS).settled_ns
    assert settled_ns is not None
    # The first half second has no speed yet.
    assert settled_ns / 1e9 == pytest.approx(CALM_S + 0.7, abs=0.3)
    assert not train.motion.over


@pytest.mark.parametrize("slip_mps", [-8.0, -1.0, 1.0, 8.0])
@pytest.mark.parametrize("felt", [True, False])
def test_a_wheel_that_returns_was_no_train_s(slip_mps: float, felt: bool) -> None:  # noqa: FBT001 - a case
    train = Train()
    train.run(8.0, SPEED_MPS + slip_mps, felt=felt)
    assert not train.motion.over
    train.run(3.0, SPEED_MPS, felt=felt)
    # Without the inertial sensor a train might have gained 1 m/s.
    assert train.motion.over is (felt or abs(slip_mps) > 1.0)


def test_a_wheel_that_locks_and_stays_so_is_never_vouched_for_until_the_sensor_is_quiet() -> None:
    train = Train()
    train.run(1.0, SPEED_MPS)
    # Gently, as far as the sensor can tell: it stays shaken.
    for k in range(30):
        train.run(0.5, SPEED_MPS * (1.0 - k / 29.0), gains_mps2=-SPEED_MPS / 14.5)
    assert train.run(40.0, 0.0).settled_ns is None
    assert not train.motion.over
    assert train.run(4.0, 0.0, shaken=0.001).over


def live_rows(log: MotionLog, method: str) -> list[Odometry]:
    live = LiveOdometry(Config(method=method, imu_latency_s=0.3), "T1", 1, None)  # type: ignore[arg-type]  # a case
    told = [one for block, device in blocks_of(log) for one in live.take(block, device)]
    return [one for one in told if isinstance(one, Odometry)]


@pytest.mark.parametrize("method", ["paper", "fused"])
@pytest.mark.parametrize("slip_mps", [4.0, -4.0])
def test_live_odometry_that_begins_in_a_slip_holds_its_bound_and_begins_anew(method: str, slip_mps: float) -> None:
    log, t_s, distance_m = run_of(slip_mps=slip_mps)
    rows = live_rows(begun_at(log, SLIDING_S), method)
    origins = list(dict.fromkeys(one.origin for one in rows))
    assert len(origins) > 1
    for origin in origins:
        ours = [one for one in rows if one.origin == origin]
        true_m = np.interp([(one.t_ns - START_NS) / 1e9 for one in ours], t_s, distance_m)
        error_m = np.array([one.distance_m for one in ours]) - ours[0].distance_m - (true_m - true_m[0])
        assert (np.abs(error_m) <= [one.bound_m for one in ours]).all()
    first = next(one for one in rows if one.status == "valid")
    # The wheel is back at 78 s, which shows within the two seconds that are compared with those before.
    assert 97.0 < (first.t_ns - START_NS) / 1e9 < 106.0
    assert all(one.reason == UNSEEN and one.speed_bound_mps == FASTEST_MPS for one in rows if one.t_ns < first.t_ns)


def test_live_odometry_that_begins_under_way_is_valid_once_the_wheel_has_been_seen_to_adhere() -> None:
    rows = live_rows(begun_at(run_of()[0], 50.0), "fused")
    assert len({one.origin for one in rows}) == 1
    first = next(one for one in rows if one.status == "valid")
    assert (first.t_ns - START_NS) / 1e9 == pytest.approx(50.0 + CALM_S + 0.8, abs=0.5)
    assert first.provisional_m < 1.0
    assert first.excess_m == pytest.approx(UNSEEN_M, abs=1.0)


def test_however_live_samples_are_cut_the_rows_are_the_same() -> None:
    log = begun_at(run_of()[0], 60.0)
    live = [LiveOdometry(Config(imu_latency_s=0.3), "T1", 1, None) for _ in range(2)]
    told = [
        [one for block, device in blocks_of(log, every_s=every_s) for one in live[k].take(block, device)]
        for k, every_s in enumerate((0.1, 0.5))
    ]
    length = min(map(len, told))
    assert length > 800
    assert told[0][:length] == told[1][:length]


@pytest.mark.parametrize("method", ["paper", "fused"])
@pytest.mark.parametrize("slip_mps", [9.0, -9.0])
def test_a_log_that_begins_in_a_slip_holds_its_bound(method: str, slip_mps: float) -> None:
    log, t_s, distance_m = run_of(slip_mps=slip_mps)
    log = begun_at(log, SLIDING_S)
    found = first_slip(log)
    assert found is not None
    # Back at 78 s, to within what the windows of speeds are long.
    assert found.until_s == pytest.approx(78.0, abs=1.5)
    rows = run_log(log, Config(method=method))  # type: ignore[arg-type]  # a case
    assert held(rows, t_s, distance_m)
    # The very first has gone no way.
    assert (rows.status[1:][rows.t_s[1:] < 76.0] == DEGRADED).all()


@pytest.mark.parametrize("method", ["paper", "fused"])
@pytest.mark.parametrize("first_s", [45.0, 62.0])
def test_a_log_that_begins_with_a_wheel_that_adheres_is_the_method_s_affair(method: str, first_s: float) -> None:
    # From 62 s on a slide comes eight seconds after the beginning.
    log = begun_at(run_of(slip_mps=4.0, gradient=0.01)[0], first_s)
    config = Config(method=method)  # type: ignore[arg-type]  # a case
    step = begin(log.vehicle, config)
    wanted = step.advance(log.end_s, log.imu_t_s, log.imu, log.tacho_t_s, log.pulses)
    found = run_log(log, config)
    for name, column in columns_of(wanted).items():
        np.testing.assert_array_equal(columns_of(found)[name], column, name)
    assert VALID in found.status
