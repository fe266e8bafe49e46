"""Diagnoses that need more than the refusal list: GNSS, the window, gaps, speed of acceptance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.landmark_passes import STEP_S, Pass, anchor_at, landmark_like, readings_of
from services.landmark_matching.anchor import Anchor
from services.landmark_matching.curve_shape import shape_of_landmark
from services.landmark_matching.matcher import Match, Matcher

LANDMARK = landmark_like(radius_m=400.0, arc_m=120.0, transition_m=50.0, hand="right")
SHAPE = shape_of_landmark(LANDMARK)
RUN = Pass([SHAPE], SHAPE.start_m - 250.0, SHAPE.end_m + 220.0, speed_mps=15.0)


def matched(anchor: Anchor, run: Pass = RUN) -> list[Match]:
    matcher = Matcher({"": [LANDMARK]}, {})
    return [match for reading in readings_of(run)[0] for match in matcher.step(reading, anchor)]


def anchor(error_m: float = 0.0, margin_m: float = 20.0) -> Anchor:
    return anchor_at(RUN.start_m, error_m=error_m, margin_m=margin_m)


def test_a_pass_without_noise_is_placed_to_decimetres() -> None:
    (match,) = matched(anchor(), replace(RUN, noise_radps=0.0))
    true_m = float(
        np.interp(match.t_s, STEP_S * np.arange(1000), SHAPE.start_m - 250.0 + 15.0 * STEP_S * np.arange(1000))
    )
    # mean curvature over 20 steps against a continuous window, linear interpolation over 1.5 m
    assert match.axis_m == pytest.approx(true_m, abs=0.2)
    assert match.accepted


def test_the_correction_is_told_only_after_the_exit_straight() -> None:
    matcher = Matcher({"": [LANDMARK]}, {})
    readings, true_m = readings_of(RUN)
    told = [place for reading, place in zip(readings, true_m, strict=True) if matcher.step(reading, anchor())]
    assert len(told) == 1
    assert told[0] >= LANDMARK.exit_straight_end_m


def test_the_correction_is_the_error_of_the_place_held() -> None:
    (match,) = matched(anchor(error_m=14.0))
    assert match.correction_m == pytest.approx(-14.0, abs=3.0)  # less a crossing's noise


def test_a_place_held_outside_its_own_margin_is_not_corrected() -> None:
    (match,) = matched(anchor(error_m=90.0))
    assert not match.accepted
    assert match.kind == "start point"
    assert "search window" in match.reason


def test_gnss_that_agrees_lets_pass_and_gnss_that_contradicts_refuses() -> None:
    assert matched(replace(anchor(error_m=14.0), gnss=(-14.0, 8.0)))[0].accepted
    (refused,) = matched(replace(anchor(error_m=14.0), gnss=(70.0, 8.0)))
    assert refused.kind == "gnss"


def test_without_a_place_nothing_is_matched() -> None:
    matcher = Matcher({"": [LANDMARK]}, {})
    assert not [match for reading in readings_of(RUN)[0] for match in matcher.step(reading, None)]


def test_a_gap_of_the_sensors_in_the_curve_refuses() -> None:
    matcher = Matcher({"": [LANDMARK]}, {})
    readings, true_m = readings_of(RUN)
    inside = [not SHAPE.arc_start_m < place < SHAPE.arc_start_m + 30.0 for place in true_m]
    kept = [reading for reading, keep in zip(readings, inside, strict=True) if keep]
    (match,) = [match for reading in kept for match in matcher.step(reading, anchor())]
    assert match.kind == "gap"


def test_another_branch_s_landmarks_are_not_looked_for() -> None:
    assert matched(replace(anchor(), branch="elsewhere")) == []


def test_the_same_run_gives_the_same_matches() -> None:
    run = replace(RUN, generator=np.random.default_rng(7))
    again = replace(RUN, generator=np.random.default_rng(7))
    first, second = matched(anchor(), run), matched(anchor(), again)
    assert [(one.t_s, one.axis_m, one.bound_m) for one in first] == [
        (one.t_s, one.axis_m, one.bound_m) for one in second
    ]
