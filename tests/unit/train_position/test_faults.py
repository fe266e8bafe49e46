"""Faults of sensors under a whole simulated train: the position tells them, and its bounds hold all the same.

No satellites and no balises: what the odometry makes of a fault is what the position has, and landmarks.
"""

from __future__ import annotations

import copy
from collections.abc import Callable

import msgspec
import pytest

from benchmarks.position import known_start, scenario_of
from benchmarks.whole_train import Chain, Judge, demo_landmarks, demo_places, judge_of
from schemas.position import FaultKind, TrainPosition
from services.landmark_matching.live_matching import LiveMatching
from services.landmark_matching.settings import MatchSettings
from services.odometry_fusion.live_odometry import LiveOdometry
from services.simulator.motion_settings import Adhesion, Tacho
from services.simulator.train_scenario import Journey, TimedFault, TrainScenario
from services.train_position.evaluation import judge
from services.train_position.keeper import PositionKeeper
from services.train_position.positions_file import positions_of, truth_of

FAULT_S = 70.0
"""Since the start: at 15 m/s, half-way between two curves."""
RUN_S = 105.0
SLIP_S = 6.0
C01_MIDDLE_M = 770.0
LOCKED_MPS = 30.0
"""Slip that stops the wheel of any train."""
SLID_M = 150.0


def scenario(**changes: object) -> TrainScenario:
    """The demo line without slips, from Kirihama on."""
    dry = {"adhesion": Adhesion(), "gnss": None}
    return msgspec.structs.replace(scenario_of(Journey(), 3, outages=False), **(dry | changes))


def driven(made: TrainScenario, seconds: float = RUN_S) -> tuple[Chain, Judge]:
    """The scenario's run with its start known within 5 m."""
    found = judge_of("odometry and landmarks", facing="up", balises=False, fixes=False)
    chain = Chain(made, 3, [found])
    chain.run(0.1)
    chain.tell(known_start(chain, chain.truth[-1].axis_m))
    chain.run(seconds)
    return chain, found


@pytest.fixture(scope="module")
def sound() -> Chain:
    """The run until shortly before a fault comes; every test takes a copy on."""
    return driven(scenario(), FAULT_S)[0]


def befallen(sound: Chain, kinds: tuple[FaultKind, ...], seconds: float) -> tuple[Chain, Judge]:
    """A copy of the run, with faults from now on."""
    chain = copy.deepcopy(sound)
    for kind in kinds:
        chain.simulation.faults.switch(kind, now_s=chain.simulation.now_s, magnitude=None, seconds=seconds)
    return chain, chain.judges[0]


def require_true(chain: Chain, found: Judge) -> None:
    figures = judge(positions_of("run", found.positions), truth_of(chain.truth))
    assert figures.compared > 0
    assert figures.within == figures.compared, figures


def degraded(one: TrainPosition) -> bool:
    return one.status == "degraded" and "odometry degraded" in one.reason


def told_by_odometry(chain: Chain, found: Judge) -> bool:
    """The odometry names it, and the position is degraded for that reason."""
    return any(one.status == "degraded" for one in chain.rows) and any(map(degraded, found.positions))


def told_as_slip(chain: Chain, found: Judge) -> bool:
    """An episode is told; while it lasts the bounds have its provisional part in them."""
    began = {one.slip for one in chain.episodes if one.phase == "began"}
    return bool(began) and any(one.slip != 0 for one in found.positions)


def harmless(chain: Chain, found: Judge) -> bool:
    """Nothing changes: the position stays valid."""
    return not chain.episodes and {one.status for one in found.positions[1:]} == {"valid"}


FAULTS: dict[FaultKind, Callable[[Chain, Judge], bool]] = {
    "imu_lost": told_by_odometry,
    "imu_frozen": told_by_odometry,
    "imu_saturated": told_by_odometry,
    "imu_late": told_by_odometry,
    "imu_axes_swapped": told_by_odometry,
    "tacho_late": told_by_odometry,
    "tacho_lost": told_by_odometry,
    "tacho_stuck": told_as_slip,
    "tacho_missing_teeth": told_as_slip,
    "tacho_reset": harmless,
    "gyro_bias": told_as_slip,
    "accelerometer_bias": told_as_slip,
    "slide": told_as_slip,
    "spin": told_as_slip,
}


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_is_told_and_the_bounds_hold(sound: Chain, kind: FaultKind) -> None:
    chain, found = befallen(sound, (kind,), SLIP_S if kind in {"slide", "spin"} else 25.0)
    chain.run(RUN_S - FAULT_S)
    require_true(chain, found)
    assert FAULTS[kind](chain, found), ([one.phase for one in chain.episodes], found.positions[-1].reason)


def test_a_sensor_turned_about_the_vertical_from_the_start_is_told_and_the_bounds_hold() -> None:
    chain, found = driven(scenario(faults=(TimedFault(kind="imu_axes_swapped", at_s=0.5, seconds=60.0),)), FAULT_S)
    require_true(chain, found)
    assert any(map(degraded, found.positions))


def test_both_sensors_late_at_once_are_told_and_the_bounds_hold(sound: Chain) -> None:
    chain, found = befallen(sound, ("imu_late", "tacho_late"), 25.0)
    chain.run(RUN_S - FAULT_S)
    require_true(chain, found)
    assert found.positions[-1].status == "degraded"
    assert found.positions[round(10.0 * (FAULT_S - 1.0))].status == "valid"


@pytest.mark.parametrize("position_too", [False, True])
def test_an_odometry_restarted_in_a_slide_is_not_believed(sound: Chain, position_too: bool) -> None:  # noqa: FBT001 - a case
    chain, found = befallen(sound, ("slide",), 2.0 * SLIP_S)
    chain.run(SLIP_S / 2.0)
    restart(chain, found, position_too=position_too)
    chain.run(4.0 * SLIP_S)
    require_true(chain, found)
    assert "not believed: it began anew while the wheels slipped" in found.positions[-1].reason


def test_a_counter_that_wraps_changes_nothing() -> None:
    wrapping, plain = (driven(scenario(tacho=Tacho(counter_bits=bits)), 60.0)[1] for bits in (8, 0))
    assert wrapping.positions == plain.positions


def test_a_wrong_wheel_diameter_stays_within_the_bounds_and_is_learned() -> None:
    chain, found = driven(scenario(tacho=Tacho(wheel_scale=0.02)), 150.0)
    require_true(chain, found)
    assert sum(one.accepted for one in found.matches) >= 2


def test_a_missing_tooth_is_a_wrong_diameter() -> None:
    chain, found = driven(scenario(tacho=Tacho(missing_teeth=1)), 100.0)
    require_true(chain, found)


def test_after_a_restart_in_a_curve_the_bounds_hold_and_a_landmark_confirms(sound: Chain) -> None:
    chain, found = befallen(sound, (), 0.0)
    # C01 turns with a radius of 300 m from 740 to 800 m.
    chain.run(RUN_S, until=lambda now: now.axis_m > C01_MIDDLE_M)
    restart(chain, found, position_too=True)
    begun = len(found.positions)
    chain.run(70.0)
    require_true(chain, found)
    after = found.positions[begun:]
    assert after[0].status == "degraded"
    assert after[0].axis_m is not None
    assert all(one.status == "degraded" for one in after if not confirmed(one, chain, found))
    assert after[-1].status == "valid"


def test_a_start_with_locked_wheels_is_told_and_the_bounds_hold(sound: Chain) -> None:
    chain, _ = befallen(sound, (), 0.0)
    chain.simulation.faults.switch("slide", now_s=chain.simulation.now_s, magnitude=LOCKED_MPS, seconds=2.0 * SLIP_S)
    chain.run(2.0)
    # Nothing is known of before: the wheel stands, and the train does not.
    found = judge_of("odometry and landmarks", facing="up", balises=False, fixes=False)
    chain.judges, chain.live = [found], LiveOdometry(chain.odometry, "T1", 2, None)
    begun = len(chain.truth)
    chain.run(0.1)
    chain.tell(known_start(chain, chain.truth[-1].axis_m))
    chain.run(2.0 * SLIP_S)
    assert chain.truth[-1].distance_m - chain.truth[begun].distance_m > SLID_M
    require_true(chain, found)
    assert found.positions
    assert {one.status for one in found.positions} == {"degraded"}
    assert "it may be locked" in found.positions[0].reason


@pytest.mark.parametrize("speed_mps", [1.8, 2.9])
def test_a_slow_start_with_locked_wheels_is_told_and_the_bounds_hold(speed_mps: float) -> None:
    chain = Chain(scenario(), 3, [])
    chain.run(60.0, until=lambda now: now.speed_mps >= speed_mps)
    chain.simulation.faults.switch("slide", now_s=chain.simulation.now_s, magnitude=LOCKED_MPS, seconds=2.0 * SLIP_S)
    chain.run(2.0)
    # Nothing is known of before, nor how much the sensor is shaken at rest.
    found = judge_of("odometry and landmarks", facing="up", balises=False, fixes=False)
    chain.judges, chain.live = [found], LiveOdometry(chain.odometry, "T1", 2, None)
    chain.run(0.1)
    chain.tell(known_start(chain, chain.truth[-1].axis_m))
    chain.run(3.0 * SLIP_S)
    require_true(chain, found)
    assert {one.status for one in found.positions} == {"degraded"}


def confirmed(position: TrainPosition, chain: Chain, found: Judge) -> bool:
    """Whether a landmark has been met between the restart and a position."""
    return any(one.t_ns <= position.t_ns and one.origin == chain.live.origin for one in found.matches if one.accepted)


def restart(chain: Chain, found: Judge, *, position_too: bool) -> None:
    """Start the odometry, and matching and position, too, anew: what they keep on disk is what they know."""
    kept = found.keeper.snapshot()
    config = found.keeper.held.config
    chain.live = LiveOdometry(chain.odometry, "T1", 2, chain.live.remembered())
    if not position_too:
        return
    found.keeper = PositionKeeper(config, demo_places(), kept)
    found.matching = LiveMatching(demo_landmarks(), MatchSettings(), 0.0, 0.0)
