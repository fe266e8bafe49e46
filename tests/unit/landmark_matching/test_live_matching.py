"""The matching as messages feed it: windows from positions, cabs, versions, origins, branches."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
import pytest

from schemas.line import Direction
from schemas.motion import Odometry
from schemas.position import BranchEvidence, LandmarkMatch, SourceState, TrainPosition
from services.landmark_matching.live_matching import LiveMatching
from services.landmark_matching.settings import MatchSettings
from tests.unit.landmark_matching.demo_runs import demo_landmarks, demo_run, true_axis
from tests.unit.landmark_matching.live_messages import T0_NS, both_of, odometry_of, position_of


def live(behind_m: float = 0.0, other_m: float = 0.0) -> LiveMatching:
    return LiveMatching(demo_landmarks(), MatchSettings(), behind_m, other_m)


def heard(matching: LiveMatching, messages: Iterable[Odometry | TrainPosition]) -> list[LandmarkMatch | BranchEvidence]:
    found: list[LandmarkMatch | BranchEvidence] = []
    for message in messages:
        if isinstance(message, Odometry):
            found += matching.take_odometry(message)
        else:
            matching.take_position(message)
    return found


@pytest.mark.parametrize(("direction", "begin_m", "end_m"), [("up", 900.0, 2400.0), ("down", 24_700.0, 23_000.0)])
def test_a_match_names_place_time_and_correction(direction: Direction, begin_m: float, end_m: float) -> None:
    readings, axis_m = demo_run(direction, begin_m, end_m)
    found = heard(live(), both_of(readings, axis_m.tolist(), direction))
    assert len(found) >= 2
    for match in found:
        assert isinstance(match, LandmarkMatch)
        assert match.accepted, match.reason
        true_m = true_axis((match.t_ns - T0_NS) / 1e9, axis_m)
        assert abs(match.axis_m - true_m) <= match.bound_m
        # the position is 12 m too far along the way; a crossing is good to 3 m
        assert match.correction_m == pytest.approx(-12.0 if direction == "up" else 12.0, abs=3.5)
        assert match.line_version == "2026-1"


def test_the_front_end_is_ahead_of_the_sensor() -> None:
    readings, axis_m = demo_run("up", 900.0, 1900.0)
    ahead = [place + 15.0 for place in axis_m.tolist()]
    (match,) = heard(live(behind_m=15.0), both_of(readings, ahead, "up", error_m=0.0))
    assert isinstance(match, LandmarkMatch)
    assert match.axis_m == pytest.approx(true_axis((match.t_ns - T0_NS) / 1e9, axis_m) + 15.0, abs=3.0)


def test_with_the_other_cab_in_front_distance_and_curvature_turn_round() -> None:
    readings, axis_m = demo_run("up", 900.0, 1900.0)
    messages: list[Odometry | TrainPosition] = []
    for k, (reading, place) in enumerate(zip(readings, axis_m.tolist(), strict=True)):
        messages.append(odometry_of(reading, sense=-1.0))
        if k % 10 == 5:
            messages.append(position_of(reading, place + 40.0, "up"))
    (match,) = heard(live(behind_m=5.0, other_m=40.0), messages)
    assert isinstance(match, LandmarkMatch)
    assert match.accepted, match.reason
    assert match.distance_m < 0.0
    assert match.axis_m == pytest.approx(true_axis((match.t_ns - T0_NS) / 1e9, axis_m) + 40.0, abs=3.0)


@pytest.mark.parametrize(
    "changes",
    [
        {"line_version": "2025-9"},
        {"status": "lost"},
        {"direction": None},
        {"bound_ahead_m": None},
        {"axis_m": None},
        {"branch": None},
    ],
)
def test_without_a_usable_position_nothing_is_matched(changes: dict[str, object]) -> None:
    readings, axis_m = demo_run("up", 900.0, 1900.0)
    sent = both_of(readings, axis_m.tolist(), "up")
    changed = [
        message if isinstance(message, Odometry) else msgspec.structs.replace(message, **changes) for message in sent
    ]
    matching = live()
    assert not [one for one in heard(matching, changed) if isinstance(one, LandmarkMatch)]
    assert bool(matching.wrong_version) == ("line_version" in changes)


def test_a_new_origin_of_the_odometry_forgets_the_curve_under_way() -> None:
    readings, axis_m = demo_run("up", 900.0, 1900.0)
    sent = both_of(readings, axis_m.tolist(), "up")
    middle = len(sent) * 6 // 10
    again = [
        msgspec.structs.replace(one, origin="o2") if isinstance(one, Odometry) and k > middle else one
        for k, one in enumerate(sent)
    ]
    assert not [one for one in heard(live(), again) if isinstance(one, LandmarkMatch) and one.accepted]


def test_repeated_and_late_messages_change_nothing() -> None:
    readings, axis_m = demo_run("up", 900.0, 1900.0)
    sent = both_of(readings, axis_m.tolist(), "up")
    twice = [one for k, message in enumerate(sent) for one in (message, sent[max(0, k - 7)])]
    assert heard(live(), twice) == heard(live(), sent)


def test_gnss_that_contradicts_refuses() -> None:
    readings, axis_m = demo_run("up", 900.0, 1900.0)
    state = SourceState(source="gnss", taken=True, age_s=0.2, difference_m=80.0, allowed_m=10.0, reason="")
    sent = [
        one if isinstance(one, Odometry) else msgspec.structs.replace(one, sources=(state,))
        for one in both_of(readings, axis_m.tolist(), "up")
    ]
    (match,) = heard(live(), sent)
    assert isinstance(match, LandmarkMatch)
    assert match.reason.startswith("gnss: place by GNSS differs")


@pytest.mark.parametrize("branch", ["", demo_landmarks().junctions[0].branch])
def test_branch_evidence_decides_for_the_way_that_was_taken(branch: str) -> None:
    junction_m = demo_landmarks().junctions[0].axis_m
    readings, axis_m = demo_run("up", junction_m - 400.0, junction_m + 2500.0, branch=branch)
    sent = both_of(readings, axis_m.tolist(), "up")
    # beyond the junction the position does not know its branch until it is told
    sent = [
        msgspec.structs.replace(one, branch=None)
        if isinstance(one, TrainPosition) and (one.axis_m or 0.0) > junction_m - 40.0
        else one
        for one in sent
    ]
    found = [one for one in heard(live(), sent) if isinstance(one, BranchEvidence)]
    decided = [one for one in found if one.decided is not None]
    assert [one.decided for one in decided[:1]] == [branch]
    assert decided[0].junction_axis_m == junction_m
    assert all(sum(chance.probability for chance in one.chances) == pytest.approx(1.0) for one in found)
