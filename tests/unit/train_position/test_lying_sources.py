"""One source lies: the interval still holds the truth, or the status says that sources contradict each other."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.position import PositionEvent, TrainPosition
from tests.unit.train_position.made_up import Run, run_with


def started(wheel_error: float = 0.0) -> Run:
    run = run_with(axis_m=2_000.0, wheel_error=wheel_error)
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    assert run.status() == "valid"
    return run


def contradictions(run: Run) -> list[str]:
    return [one.text for one in run.heard if isinstance(one, PositionEvent) and one.kind == "contradiction"]


def holds(run: Run) -> bool:
    least_m, greatest_m = run.margin_m()
    return least_m <= run.front_m <= greatest_m


def test_a_lying_landmark_is_kept_beside_what_else_is_known() -> None:
    run = started()
    run.go(20.0)
    run.hear(run.front_end(1.0, 5.0))
    run.hear(run.landmark("C0", 0.0, 10.0))
    run.go(0.1)
    run.hear(run.landmark("C1", 120.0, 10.0))
    run.go(0.1)
    position = run.position
    assert position.reference == "C0", "what contradicts the others is no reference"
    assert position.status == "degraded"
    assert "sources contradict each other (satellites, C0 against C1)" in position.reason
    least_m, greatest_m = run.margin_m()
    # The union of both claims, with everything between, and the odometry's part of one step.
    assert least_m <= run.front_m - 3.0
    assert greatest_m >= run.front_m + 125.0
    assert "landmark C1" in contradictions(run)[0]
    assert position.axis_m is not None
    assert abs(position.axis_m - run.front_m) < 5.0, "not the mean of the two"


def test_the_same_source_does_not_settle_its_own_quarrel() -> None:
    run = started()
    run.hear(run.front_end(90.0, 5.0))
    for _ in range(100):
        run.go(0.4)
        run.hear(run.front_end(90.0, 5.0))
    assert run.status() == "degraded"
    assert holds(run)


@pytest.mark.parametrize("reference", ["landmark", "balise"])
def test_a_reference_settles_it(reference: str) -> None:
    run = started()
    run.hear(run.front_end(90.0, 5.0))
    run.go(5.0)
    run.hear(run.landmark("C1") if reference == "landmark" else run.balise())
    run.go(0.1)
    assert run.status() == "valid"
    assert holds(run)
    least_m, greatest_m = run.margin_m()
    assert greatest_m - least_m < 25.0
    assert len(contradictions(run)) == 2
    assert "resolved" in contradictions(run)[1]


def test_satellites_settle_it_elsewhere_when_they_have_come_to_agree() -> None:
    run = started()
    run.hear(run.landmark("C1", 0.0, 5.0))
    run.hear(run.front_end(90.0, 5.0))
    run.go(1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    assert run.status() == "degraded", "a second later their errors are the same ones"
    run.go(40.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    assert run.status() == "valid"
    assert holds(run)


def test_a_repeated_landmark_is_no_further_evidence() -> None:
    run = started()
    lie = run.landmark("C1", 120.0, 10.0)
    run.hear(lie)
    run.hear(lie)
    run.go(0.1)
    assert run.status() == "degraded"
    assert run.keeper.refused == {"repeated": 1}


def test_claims_that_barely_overlap_contradict_each_other() -> None:
    run = started()
    run.hear(run.landmark("C1", 14.99, 10.0))
    run.go(0.1)
    assert run.status() == "degraded"


LIES = st.floats(-400.0, 400.0)


@settings(max_examples=150, deadline=None)
@given(
    liar=st.sampled_from(["gnss", "landmark", "balise"]),
    lie_m=LIES,
    wheel=st.floats(-0.02, 0.02),
    legs=st.lists(st.tuples(st.integers(5, 60), st.floats(-0.9, 0.9)), min_size=2, max_size=6),
)
def test_one_liar_among_three(liar: str, lie_m: float, wheel: float, legs: list[tuple[int, float]]) -> None:
    """A lie beyond true claims is seen; one hidden among them moves the interval by no more than they are wide."""
    run = started(wheel_error=wheel)
    for number, (count, share) in enumerate(legs):
        run.go(0.1 * count)
        run.hear(run.front_end(lie_m if liar == "gnss" else share * 5.0, 5.0))
        run.hear(run.landmark(f"C{number}", lie_m if liar == "landmark" else share * 10.0, 10.0))
        balise = run.balise(lie_m if liar == "balise" else share)
        if liar == "balise":
            balise = type(balise)(
                t_ns=balise.t_ns,
                balise=balise.balise,
                sensor_offset_m=balise.sensor_offset_m,
                detection_bound_m=1.0,
            )
        run.hear(balise)
        run.go(0.1)
        position = run.position
        least_m, greatest_m = run.margin_m()
        outside_m = max(least_m - run.front_m, run.front_m - greatest_m, 0.0)
        # What overlaps a true claim cannot be further from the truth than that is wide: satellites' 10 m where the
        # balise lies, the balise's 4 m otherwise, and the odometry's share of the way since (60 steps of 1 m, twice).
        hidden_m = (10.0 if liar == "balise" else 4.0) + 2 * 0.02 * 61.0
        assert position.status != "valid" or outside_m <= hidden_m
        if abs(lie_m) > 10.0 + 2.0 * hidden_m:
            assert position.status != "valid" or outside_m == 0.0


def test_too_many_alternatives_become_one_wide_one() -> None:
    run = started()
    for number in range(6):
        run.hear(run.landmark(f"C{number}", 100.0 * (number + 1), 5.0))
    run.go(0.1)
    least_m, greatest_m = run.margin_m()
    assert holds(run)
    assert greatest_m - least_m > 590.0
    assert run.status() == "degraded"
    run.hear(run.balise())
    run.go(0.1)
    assert run.status() == "valid"
    assert holds(run)
    assert isinstance(run.heard[-1], TrainPosition)
