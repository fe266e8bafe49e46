"""An odometry that says what no train can do, or begins in a slip, is not believed; physics holds the bounds."""

from __future__ import annotations

from typing import Literal

import msgspec
import pytest

from schemas.position import TrainChange
from services.train_position.keeper import PositionKeeper
from services.train_position.makeup import Makeup
from services.train_position.settings import Config
from services.train_position.snapshot import Snapshot
from tests.unit.train_position.made_up import LENGTH_OF_TRAIN_M, Run, events_of, run_with

CALM_S = 20.0
BRAKE_S = 3.0
"""In which the mistaken odometries here lose 3 to 12 m/s: more than the 1.5 m/s² of the settings."""


def running(bound_m: float = 5.0) -> Run:
    """20 m/s, known within 5 m."""
    run = run_with()
    run.go(20.0, 1.0)
    run.hear(run.front_end(0.0, bound_m))
    run.go(5.0)
    return run


def tell(run: Run, seconds: float, counted_mps: float, *, slip: Literal[-1, 0, 1] = 0, **changes: object) -> None:
    """The odometry counts with another speed than the train's."""
    for _ in range(round(seconds * 10)):
        run.go(0.1, silent=True)
        run.distance_m += (counted_mps - run.speed_mps) * 0.1
        run.way_m += (counted_mps - run.speed_mps) * 0.1
        said = {"speed_mps": counted_mps, "slip": slip} | changes
        run.heard += run.keeper.on_odometry(run.odometry(**said))
        run.require_true()


def believed(run: Run) -> bool:
    return "not believed" not in run.position.reason


def anew(run: Run, origin: str) -> None:
    """The odometry counts from another zero."""
    run.origin, run.distance_m, run.way_m, run.excess_m, run.provisional_m = origin, 0.0, 0.0, 0.0, 0.0


def test_a_speed_that_no_train_loses_is_not_believed() -> None:
    run = running()
    tell(run, BRAKE_S, 8.0)
    assert run.status() == "degraded"
    assert "from 20.0 to 8.0 m/s" in run.position.reason
    assert any("not believed" in one for one in events_of(run, "change"))
    # It settles there, calm and wrong, for less long than slips may last; then the wheel adheres again.
    tell(run, CALM_S - 2.0 * BRAKE_S, 8.0)
    tell(run, 1.0, 14.0, slip=1)
    run.go(CALM_S + 1.0)
    run.require_true()
    assert believed(run)


def test_a_way_that_does_not_go_with_the_speed_is_not_believed() -> None:
    # It is seen once the way lacks what physics allows within some seconds: 20 m.
    run = running(30.0)
    tell(run, 2.0 * BRAKE_S, 0.0, speed_mps=20.0)
    assert not believed(run)
    assert "20.0 m/s" in run.position.reason


def test_braking_and_starting_as_hard_as_trains_do_is_believed() -> None:
    run = running()
    for acceleration_mps2 in (-1.4, 1.4, -0.7, 0.9):
        run.go(8.0, acceleration_mps2)
        assert run.status() == "valid"
        run.require_true()


def test_a_slip_seen_right_after_sensors_were_silent_is_not_believed() -> None:
    run = running()
    run.go(1.0, silent=True)
    run.heard += run.keeper.on_odometry(run.odometry(status="degraded", reason="no inertial sensor"))
    tell(run, 1.0, 18.0, slip=-1)
    assert "right after sensors were silent" in run.position.reason
    tell(run, 10.0, 17.0, slip=-1)
    assert run.status() == "degraded"


@pytest.mark.parametrize("service", [False, True])
def test_an_odometry_that_begins_in_a_slide_is_not_believed_until_it_has_been_calm(service: bool) -> None:  # noqa: FBT001 - a case
    run = running()
    tell(run, 2.0, 20.0, slip=-1, provisional_m=1.0)
    if service:
        kept = run.keeper.snapshot()
        assert kept is not None
        again = msgspec.json.decode(msgspec.json.encode(kept), type=Snapshot)
        run.keeper = PositionKeeper(run.keeper.held.config, run.keeper.held.line, again)
    anew(run, "o2")
    # It takes the sliding wheel's speed for the train's, and regained adhesion for a spin.
    tell(run, 8.0, 15.0)
    tell(run, 5.0, 15.0, slip=1)
    assert not believed(run)
    run.go(CALM_S + 0.2)
    run.require_true()
    assert believed(run)
    # Where it had carried the train by then is not believed: only what physics allows is known.
    assert (run.position.bound_ahead_m or 0.0) > 100.0
    run.hear(run.balise())
    run.go(0.1)
    run.require_true()
    assert (run.position.bound_ahead_m or 0.0) < 5.0


def test_an_odometry_that_begins_under_way_is_believed_once_it_has_been_calm() -> None:
    run = running()
    bound_m = run.position.bound_ahead_m or 0.0
    run.go(0.5, silent=True)
    anew(run, "o2")
    run.go(CALM_S - 1.0)
    run.require_true()
    assert not believed(run)
    assert (run.position.bound_ahead_m or 0.0) > 100.0
    run.go(2.0)
    run.require_true()
    assert run.status() == "valid"
    # What it counted meanwhile holds: 2 % of 21 s at 20 m/s, and half a second of physics.
    assert (run.position.bound_ahead_m or 0.0) < bound_m + 10.0


def test_a_slip_while_it_is_not_believed_yet_begins_the_wait_anew() -> None:
    run = running()
    anew(run, "o2")
    run.go(CALM_S - 5.0)
    tell(run, 1.0, 20.0, slip=-1)
    run.go(CALM_S - 1.0)
    assert not believed(run)
    run.go(2.0)
    assert believed(run)
    run.require_true()


def test_doubt_survives_a_restart_of_the_position() -> None:
    run = running()
    tell(run, BRAKE_S, 8.0)
    kept = run.keeper.snapshot()
    assert kept is not None
    run.keeper = PositionKeeper(run.keeper.held.config, run.keeper.held.line, kept)
    tell(run, 3.0, 8.0)
    assert not believed(run)


def test_a_change_of_cabs_turns_the_speed_that_physics_goes_on_from() -> None:
    config = Config(clock_bound_s=0.0, holdover=0.0, line_accuracy_m=0.0, facing="up", state=False)
    run = run_with(config, makeup=Makeup(LENGTH_OF_TRAIN_M, "A", forward="cab"))
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 2.0))
    run.go(0.1)
    anew(run, "o2")
    run.go(0.1)
    assert not believed(run)
    run.hear(TrainChange(t_ns=run.t_ns, kind="cab", cab="B"))
    run.go(1.0, silent=True)
    run.heard += run.keeper.on_odometry(run.odometry(speed_mps=-run.speed_mps))
    position = run.position
    assert position.max_safe_front_end_m is not None
    assert position.min_safe_front_end_m is not None
    # The other end leads: 60 m towards falling places, and the train rolls on towards rising ones.
    front_m = run.axis_m - LENGTH_OF_TRAIN_M
    assert position.max_safe_front_end_m <= front_m <= position.min_safe_front_end_m
