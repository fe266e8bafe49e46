"""A train that runs back with the same sensors: the other cab leads, and they count backwards."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from benchmarks.position import known_start, scenario_of
from benchmarks.whole_train import Chain, demo_landmarks, judge_of
from schemas.position import TrainChange, TrainPosition
from services.landmark_matching.live_matching import LiveMatching
from services.landmark_matching.settings import MatchSettings
from services.simulator.motion_settings import Adhesion
from services.simulator.train_scenario import Journey
from services.train_position.evaluation import judge
from services.train_position.positions_file import positions_of, truth_of
from tests.unit.train_position.made_up import run_with

START_M = 23_000.0
"""Two curves before the end of the demo line."""
NEAR_END_M = 25_000.0
READER_M = 20.0
B02_M = 2_730.0


def test_running_back_with_the_same_sensors_keeps_the_bounds() -> None:
    journey = Journey(start_axis_m=START_M, sensors="vehicle")
    made = msgspec.structs.replace(scenario_of(journey, 3, outages=False), adhesion=Adhesion(), gnss=None)
    found = judge_of("fixed sensors", facing="up", forward="vehicle", balises=False, fixes=False)
    found.matching = LiveMatching(demo_landmarks(), MatchSettings(), 0.0, found.keeper.held.config.length_m)
    chain = Chain(made, 3, [found])
    chain.run(0.1)
    chain.tell(known_start(chain, chain.truth[-1].axis_m))
    chain.run(600.0, until=lambda now: bool(chain.changes) and now.axis_m < START_M)
    figures = judge(positions_of("run", found.positions), truth_of(chain.truth))
    assert 0 < figures.compared == figures.within
    turned_ns = chain.changes[0].t_ns
    assert chain.rows[-1].speed_mps < 0.0
    # There and back, but for the train's own length: the other end is the front then.
    assert chain.rows[-1].distance_m == pytest.approx(found.keeper.held.config.length_m, abs=0.02 * 5_000.0)
    assert any(one.accepted for one in found.matches if one.t_ns < turned_ns)
    assert any(one.accepted and one.direction == "down" for one in found.matches if one.t_ns > turned_ns)
    after = [one for one in found.positions if one.t_ns > turned_ns + 1_000_000_000]
    assert {one.direction for one in after} == {"down"}
    assert all(one.speed_mps is None or one.speed_mps > -one_sided(one) for one in after)


def test_propelled_from_the_same_cab_the_bounds_hold() -> None:
    journey = Journey(start_axis_m=NEAR_END_M, propels=True)
    made = msgspec.structs.replace(scenario_of(journey, 3, outages=False), adhesion=Adhesion(), gnss=None)
    found = judge_of("propelled", facing="up", forward="vehicle", fixes=False)
    chain = Chain(made, 3, [found])
    chain.run(0.1)
    chain.tell(known_start(chain, chain.truth[-1].axis_m))
    chain.run(400.0, until=lambda now: now.axis_m < NEAR_END_M)
    assert not chain.changes
    places_m = np.array([one.axis_m for one in chain.truth])
    # The front end stays where it is when the train is driven the other way: 30 m/s is 3 m in a step.
    assert np.max(np.abs(np.diff(places_m))) < 3.0
    assert np.max(places_m) > NEAR_END_M + 250.0
    assert chain.rows[-1].speed_mps < -1.0
    assert chain.rows[-1].distance_m == pytest.approx(places_m[-1] - places_m[0], abs=0.02 * 700.0)
    figures = judge(positions_of("run", found.positions), truth_of(chain.truth))
    assert 0 < figures.compared == figures.within
    assert {one.direction for one in found.positions} == {"up"}
    assert found.positions[-1].speed_mps == pytest.approx(chain.rows[-1].speed_mps)


def test_what_a_propelled_train_passes_is_where_its_sensors_are() -> None:
    journey = Journey(start_axis_m=3_000.0, direction="down", stops=("matsuo", "kuzuhara"), propels=True)
    plain = scenario_of(journey, 3, outages=False)
    made = msgspec.structs.replace(plain, adhesion=Adhesion(), gnss=None, balise_reader_behind_front_m=READER_M)
    simulation = Chain(made, 3, []).simulation
    ticks = [simulation.step() for _ in range(1_500)]
    passed = [(tick.truth.axis_m, one) for tick in ticks if tick.truth is not None for one in tick.balises]
    # Just before its last stop, and again as it is propelled away from there.
    assert [one.balise for _, one in passed] == ["B02", "B02"]
    for axis_m, one in passed:
        assert one.sensor_offset_m == READER_M
        # Facing down, the reader is above the front end. A tick, and the reader's error, make up to 3 m.
        assert axis_m + READER_M == pytest.approx(B02_M, abs=3.0)


def one_sided(position: TrainPosition) -> float:
    """How far a speed of rest may be below nought."""
    return position.speed_bound_mps or 0.0


def test_a_train_at_rest_has_no_minus_before_its_speed() -> None:
    run = run_with()
    run.go(1.0)
    run.hear(run.front_end())
    run.hear(TrainChange(t_ns=run.t_ns, kind="cab", cab="B"))
    run.go(0.1)
    assert str(run.position.speed_mps) == "0.0"
