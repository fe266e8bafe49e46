from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from schemas.position import FaultKind
from services.simulator.fault_board import USUAL, FaultBoard, command_of
from services.simulator.motion_settings import MotionSettings, Tacho
from services.simulator.motion_simulator import MotionSimulator
from services.simulator.train_scenario import TimedFault
from services.simulator.train_sensors import BLOCK, SensorBlock, TrainSensors
from tests.unit.simulator.motion_tracks import PERFECT, uniform_track


def blocks(count: int, faults: dict[FaultKind, float], warm: int = 800) -> list[SensorBlock]:
    """Blocks under faults that come on after `warm` blocks without any; the train is then under way."""
    settings = MotionSettings(imu=PERFECT, tacho=Tacho(wheel_scale=0.0))
    simulator = MotionSimulator(uniform_track(curvature_per_m=1 / 400.0), settings, np.random.default_rng(1))
    sensors = TrainSensors(settings, np.random.default_rng(2))
    for _ in range(warm):
        sensors.block(simulator.advance(BLOCK), {})
    return [sensors.block(simulator.advance(BLOCK), faults) for _ in range(count)]


def test_every_kind_has_a_usual_magnitude() -> None:
    assert set(USUAL) == set(get_args(FaultKind))


def test_timed_faults_come_and_go_and_hands_win() -> None:
    board = FaultBoard((TimedFault(kind="slide", at_s=2.0, seconds=3.0), TimedFault(kind="imu_lost", at_s=1.0)))
    assert board.at(0.0) == {}
    assert board.at(1.0) == {"imu_lost": 1.0}
    assert board.at(2.0) == {"imu_lost": 1.0, "slide": 3.0}
    board.switch("slide", now_s=2.5, magnitude=5.0, seconds=None)
    assert board.at(100.0) == {"imu_lost": 1.0, "slide": 5.0}
    board.clear("slide")
    board.clear("spin")
    assert board.at(101.0) == {"imu_lost": 1.0}


def test_only_wheel_faults_reach_the_wheel() -> None:
    assert command_of({"slide": 3.0, "imu_lost": 1.0}) == (-3.0, 0.0)
    assert command_of({"spin": 2.0, "micro_slip": 0.02}) == (2.0, 0.02)
    assert command_of({}) == (0.0, 0.0)


def test_without_faults_samples_are_the_truth_s_and_stamped_now() -> None:
    block = blocks(1, {})[0]
    assert block.imu.shape == (10, 6)
    assert block.imu_t_s == pytest.approx(np.arange(8001, 8011) / 100)
    assert block.tacho_t_s == pytest.approx([80.1])
    # At 80 s the train runs in a left curve of 400 m.
    assert np.all(block.imu[:, 5] > 0.01)


def test_frozen_values_stay() -> None:
    frozen = np.concatenate([block.imu for block in blocks(5, {"imu_frozen": 1.0})])
    assert np.all(frozen == frozen[0])


def test_saturated_values_are_cut_and_told() -> None:
    some = blocks(3, {"imu_saturated": 0.05})
    assert all(block.imu_fault == "saturated" for block in some)
    assert np.abs(np.concatenate([b.imu for b in some])[:, 3:]).max() == pytest.approx(0.005)
    assert np.concatenate([b.imu for b in some])[:, 2] == pytest.approx(0.05 * 9.80665)


def test_swapped_axes_are_a_quarter_turn() -> None:
    right, wrong = blocks(1, {})[0].imu, blocks(1, {"imu_axes_swapped": 1.0})[0].imu
    assert wrong[:, [0, 1, 2]] == pytest.approx(np.stack([right[:, 1], -right[:, 0], right[:, 2]], axis=1))
    assert wrong[:, [3, 4, 5]] == pytest.approx(np.stack([right[:, 4], -right[:, 3], right[:, 5]], axis=1))


def test_late_sensors_hold_back_and_then_show_the_past() -> None:
    usual, late = blocks(30, {}), blocks(30, {"imu_late": 2.0, "tacho_late": 1.0})
    assert [len(block.imu) for block in late[:20]] == [0] * 20
    assert np.array_equal(late[20].imu, usual[0].imu)
    assert late[20].imu_t_s == pytest.approx(usual[20].imu_t_s)
    assert [len(block.counts) for block in late[:11]] == [0] * 10 + [1]
    assert late[10].counts == usual[0].counts


def test_a_stuck_counter_loses_what_passes() -> None:
    stuck = blocks(10, {"tacho_stuck": 1.0})
    assert len({int(block.counts[-1]) for block in stuck}) == 1
    assert len(blocks(3, {"tacho_lost": 1.0})[0].counts) == 0


def test_missing_teeth_and_a_reset_show_in_the_counts() -> None:
    usual, fewer = blocks(100, {}), blocks(100, {"tacho_missing_teeth": 45.0})
    gone = [int(some[-1].counts[-1] - some[0].counts[-1]) for some in (usual, fewer)]
    # Half of the teeth, up to half a revolution.
    assert gone[1] == pytest.approx(gone[0] / 2, abs=45)
    assert blocks(1, {"tacho_reset": 1.0})[0].counts[-1] < 100
