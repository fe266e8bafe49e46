"""Whole runs over the demo line: placed by their curvature, matched, followed over a junction."""

from __future__ import annotations

import pytest

from schemas.line import Direction
from services.landmark_matching.run_matching import PlaceError, Start, match_run
from services.landmark_matching.settings import MatchSettings
from tests.unit.landmark_matching.demo_runs import demo_landmarks, demo_line, demo_run, true_axis

SETTINGS = MatchSettings()
JUNCTION_M = demo_landmarks().junctions[0].axis_m
BRANCH = demo_landmarks().junctions[0].branch


@pytest.mark.parametrize(("direction", "begin_m", "end_m"), [("up", 300.0, 4000.0), ("down", 24_900.0, 21_000.0)])
def test_a_run_is_placed_and_matched_without_being_told_anything(
    direction: Direction, begin_m: float, end_m: float
) -> None:
    readings, axis_m = demo_run(direction, begin_m, end_m)
    found = match_run(readings, demo_landmarks(), None, SETTINGS, 0.02)
    assert len(found.matches) >= 3
    for match in found.matches:
        assert match.accepted, match.reason
        assert match.landmark.direction == direction
        assert abs(match.axis_m - true_axis(match.t_s, axis_m)) <= match.bound_m


@pytest.mark.parametrize("branch", ["", BRANCH])
def test_the_branch_is_chosen_by_the_curvature(branch: str) -> None:
    begin_m = JUNCTION_M - 2500.0
    readings, _ = demo_run("up", begin_m, JUNCTION_M + 3000.0, branch=branch)
    found = match_run(readings, demo_landmarks(), Start("", "up", begin_m, 20.0), SETTINGS, 0.02)
    assert found.placed[-1].anchor.branch == branch
    assert found.placed[-1].reason.startswith("curvature of")
    beyond = [match for match in found.matches if match.landmark.exit_lower_limit_m > JUNCTION_M + 700.0]
    assert beyond
    assert {match.landmark.branch for match in beyond} == {branch}
    assert all(match.accepted for match in beyond)


def test_a_train_lost_by_a_wrong_start_is_found_again() -> None:
    readings, axis_m = demo_run("up", 300.0, 12_000.0)
    found = match_run(readings, demo_landmarks(), Start("", "down", 20_000.0, 20.0), SETTINGS, 0.02)
    assert [placed.reason for placed in found.placed[:2]] == ["as given", "lost, found by the curvature"]
    accepted = [match for match in found.matches if match.accepted]
    assert accepted
    for match in accepted:
        assert abs(match.axis_m - true_axis(match.t_s, axis_m)) <= match.bound_m


def test_a_train_that_turns_back_at_the_end_of_the_line_is_found_again() -> None:
    there, _ = demo_run("up", 22_000.0, 25_300.0)
    back, axis_m = demo_run("down", 25_300.0, 20_500.0)
    t_s, distance_m = there[-1].t_s + 0.1, there[-1].distance_m
    later = [
        one._replace(
            t_s=one.t_s + t_s,
            distance_m=one.distance_m + distance_m,
            curvature_distance_m=one.curvature_distance_m + distance_m,
        )
        for one in back
    ]
    start = Start("", "up", 22_000.0, 20.0)
    found = match_run([*there, *later], demo_landmarks(), start, SETTINGS, 0.02)
    assert [placed.anchor.direction for placed in found.placed] == ["up", "down"]
    returning = [match for match in found.matches if match.accepted and match.landmark.direction == "down"]
    assert len(returning) >= 3
    for match in returning:
        assert abs(match.axis_m - true_axis(match.t_s - t_s, axis_m)) <= match.bound_m


def test_a_straight_run_tells_no_place() -> None:
    readings, _ = demo_run("up", 5900.0, 6300.0)
    with pytest.raises(PlaceError, match="say where it begins"):
        match_run(readings, demo_landmarks(), None, SETTINGS, 0.02)


def test_no_readings_are_no_run() -> None:
    with pytest.raises(PlaceError, match="no odometry"):
        match_run([], demo_landmarks(), None, SETTINGS, 0.02)


def test_the_demo_line_has_landmarks_in_both_directions_and_on_its_branch() -> None:
    known = demo_landmarks()
    assert {one.direction for one in known.landmarks[""]} == {"up", "down"}
    assert any(one.branch == BRANCH for one in known.landmarks[BRANCH])
    assert known.line_version == demo_line().version
