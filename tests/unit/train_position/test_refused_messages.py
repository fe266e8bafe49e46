"""What cannot be is refused, counted, and changes nothing."""

from __future__ import annotations

import pytest

from schemas.position import BalisePassage, BranchEvidence, ReferencePass, TrainChange
from tests.unit.train_position.made_up import START_NS, events_of, run_with


@pytest.mark.parametrize(
    ("message", "kind"),
    [
        (BalisePassage(t_ns=START_NS + 10**10, balise="unknown"), "balise"),
        (BalisePassage(t_ns=START_NS + 10**10, balise="B2", sensor_offset_m=1e30), "balise"),
        (BalisePassage(t_ns=-5, balise="B2"), "old"),
        (BalisePassage(t_ns=START_NS + 10**16, balise="B2"), "time"),
        (TrainChange(t_ns=START_NS + 10**10, kind="coupled", length_m=1e12), "change"),
        (TrainChange(t_ns=START_NS + 10**10, kind="coupled", length_m=1.0), "change"),
        (TrainChange(t_ns=START_NS + 10**10, kind="uncoupled", length_m=100.0), "change"),
        (TrainChange(t_ns=START_NS + 10**10, kind="cab"), "change"),
        (TrainChange(t_ns=START_NS + 10**10, kind="route", branch="nowhere"), "change"),
        (
            BranchEvidence(t_ns=START_NS + 10**10, junction_axis_m=1.0, decided="nowhere", chances=(), reason=""),
            "branch",
        ),
        (
            BranchEvidence(t_ns=START_NS + 10**10, junction_axis_m=20_000.0, decided="north", chances=(), reason=""),
            "branch",
        ),
    ],
)
def test_absurd_messages_are_counted_and_change_nothing(message: BalisePassage | TrainChange, kind: str) -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    before = run.margin_m()
    run.hear(message)
    after = run.keeper.on_odometry(run.odometry(t_ns=run.t_ns + 1))
    assert run.keeper.refused == {kind: 1}
    run.heard += after
    assert run.margin_m() == pytest.approx(before, abs=0.01)
    assert len(run.keeper.take_refusals()) == 1
    assert run.keeper.take_refusals() == []


@pytest.mark.parametrize(
    "changes",
    [
        {"distance_m": 1e30},
        {"speed_mps": -1e9},
        {"excess_m": 1e12},
        {"share_bound": 55.0},
        {"t_ns": -1},
        {"way_m": 0.0},
        {"t_ns": START_NS},
    ],
)
def test_absurd_odometry_is_refused(changes: dict[str, object]) -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    run.t_ns += 100_000_000
    assert run.keeper.on_odometry(run.odometry(**changes)) == []
    assert run.keeper.refused == {"odometry": 1}
    run.axis_m += 1.0
    run.distance_m += 1.0
    run.way_m += 1.0
    run.heard += run.keeper.on_odometry(run.odometry())
    run.require_true()
    assert run.status() == "valid"


def test_another_line_version_refuses_landmarks() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    for number in range(3):
        run.go(1.0)
        run.hear(run.landmark(f"C{number}", 0.0, 1.0, line_version="2"))
    assert run.keeper.refused == {"line_version": 3}
    assert "version 2" in events_of(run, "line_version")[0]
    assert not [one for one in run.heard if isinstance(one, ReferencePass)]


def test_a_landmark_met_in_the_other_direction_is_refused() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.hear(run.landmark("C1", direction="down"))
    assert run.keeper.refused == {"landmark": 1}


def test_a_refused_match_is_shown_and_not_taken() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.hear(run.landmark("C1", accepted=False, reason="length", bound_m=0.0))
    run.go(0.1)
    (state,) = [one for one in run.position.sources if one.source == "landmark"]
    assert not state.taken
    assert "length" in state.reason
    assert run.keeper.refused == {}


def test_two_landmarks_at_a_wrong_distance_make_no_place() -> None:
    run = run_with()
    run.go(20.0, 0.5)
    run.hear(run.landmark("C1", 300.0))
    run.go(30.0)
    run.hear(run.landmark("C2"))
    run.go(0.1)
    assert run.status() == "lost"
