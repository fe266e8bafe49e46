"""From nothing known to a place and a direction."""

from __future__ import annotations

import pytest

from schemas.position import BalisePassage
from services.train_position.settings import AntennaPlace, Config
from tests.unit.train_position.made_up import events_of, fix_of, run_with


def test_nothing_known_is_lost_with_a_reason_and_no_place() -> None:
    run = run_with()
    run.go(1.0, 1.0)
    position = run.position
    assert position.status == "lost"
    assert position.reason
    assert position.axis_m is None
    assert position.occupied == ()
    assert position.speed_mps is not None


def test_direction_by_the_way_from_place_to_place() -> None:
    run = run_with(sense=-1, axis_m=9_000.0)
    run.go(10.0, 1.0)
    for _ in range(20):
        run.hear(run.front_end(0.0, 5.0, facing=None))
        run.go(1.0)
    assert run.position.direction == "down"
    assert run.position.speed_mps == pytest.approx(10.0)
    assert len(events_of(run, "direction")) == 1
    run.require_true()
    # What was claimed before the direction was known is taken anew: no more than a claim and a second's share.
    assert (run.position.bound_ahead_m or 0.0) < 6.0


def test_direction_by_the_satellites_speed() -> None:
    run = run_with(
        Config(antennas={"front": AntennaPlace(behind_m=2.0)}, clock_bound_s=0.0, holdover=0.0, forward="vehicle")
    )
    run.go(10.0, 1.0)
    run.hear(fix_of(run, 2.0), "front")
    run.hear(fix_of(run, 2.0, t_ns=run.t_ns - 1), "front")
    run.go(0.1)
    run.hear(fix_of(run, 2.0), "front")
    run.go(0.1)
    assert run.position.direction == "up"
    run.require_true()


def test_a_first_place_takes_two_landmarks() -> None:
    run = run_with()
    run.go(20.0, 0.5)
    run.hear(run.landmark("C1"))
    run.go(30.0)
    assert run.status() == "lost"
    assert "another landmark" in run.position.reason
    run.hear(run.landmark("C2"))
    run.go(0.1)
    assert run.status() == "valid"
    run.require_true()


def test_a_balise_makes_a_first_place() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(BalisePassage(t_ns=run.t_ns, balise="B2"))
    run.go(0.1)
    assert run.status() == "degraded"
    assert "direction" in run.position.reason
