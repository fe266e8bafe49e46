"""Diagnoses that need more than the refusal list: GNSS, the window, gaps, speed of acceptance."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.landmark_passes import STEP_S, Pass, anchor_at, landmark_like, readings_of
from services.landmark_matching.anchor import Anchor
from services.landmark_matching.curve_shape import CurveShape, shape_of_landmark
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


def bend(start_m: float, end_m: float, radius_m: float = 1500.0) -> CurveShape:
    """Another bend to the same hand; by itself far below the lower limit."""
    return CurveShape(start_m, start_m + 10.0, end_m - 10.0, end_m, SHAPE.curvature_per_m * 400.0 / radius_m)


QUIET = replace(RUN, noise_radps=0.0)
ARC_M = 0.5 * (SHAPE.arc_start_m + SHAPE.arc_end_m)
REFUSED = {
    "entry straight": replace(QUIET, curves=[SHAPE, bend(RUN.start_m - 200.0, SHAPE.start_m + 10.0)]),
    "upper limit": replace(QUIET, curves=[SHAPE, bend(SHAPE.arc_start_m, SHAPE.arc_end_m, 1200.0)]),
    "lower limit": replace(QUIET, yaw_scale=0.79, bias_radps=-1.2e-3),
    "curvature": replace(QUIET, yaw_scale=1.208),
    "exit straight": replace(QUIET, curves=[SHAPE, bend(SHAPE.end_m - 10.0, RUN.end_m + 200.0)]),
    "shape": replace(
        QUIET, curves=[SHAPE, bend(SHAPE.arc_start_m, ARC_M, 2300.0), bend(ARC_M, SHAPE.arc_end_m, -2300.0)]
    ),
}
"""By what the diagnosis is for that finds it; what the refusal list has is there."""


@pytest.mark.parametrize("kind", REFUSED)
def test_each_diagnosis_refuses_what_it_is_for(kind: str) -> None:
    (match,) = matched(anchor(), REFUSED[kind])
    assert match.kind == kind, match.reason
    assert match.reason.startswith(f"{kind}: ")


def test_a_correction_that_the_margin_does_not_explain_is_refused() -> None:
    # the entry may lie half a window (15 m) and the landmark's accuracy (3 m) off, the exit is known better
    held = anchor_at(RUN.start_m, error_m=15.0, margin_m=0.0)
    (match,) = matched(replace(held, share=0.0), QUIET)
    assert match.kind == "window", match.reason


def test_running_back_within_the_curve_is_refused() -> None:
    matcher = Matcher({"": [LANDMARK]}, {})
    readings, true_m = readings_of(RUN)
    back = [
        reading._replace(speed_mps=-1.0) if ARC_M < place < ARC_M + 10.0 else reading
        for reading, place in zip(readings, true_m, strict=True)
    ]
    (match,) = [match for reading in back for match in matcher.step(reading, anchor())]
    assert match.kind == "reverse running"


def test_a_sensor_without_curvature_is_told() -> None:
    matcher = Matcher({"": [LANDMARK]}, {})
    blind = [reading._replace(curvature_per_m=math.nan) for reading in readings_of(RUN)[0]]
    (match,) = [match for reading in blind for match in matcher.step(reading, anchor())]
    assert match.kind == "no curvature"


def test_landmarks_behind_the_place_first_held_are_not_missed() -> None:
    run = replace(RUN, curves=[], start_m=SHAPE.end_m + 60.0, end_m=SHAPE.end_m + 400.0)
    found_beyond = anchor_at(run.start_m, error_m=0.0, margin_m=200.0)
    assert matched(found_beyond, run) == []


def test_another_branch_s_landmarks_are_not_looked_for() -> None:
    assert matched(replace(anchor(), branch="elsewhere")) == []


def test_the_same_run_gives_the_same_matches() -> None:
    run = replace(RUN, generator=np.random.default_rng(7))
    again = replace(RUN, generator=np.random.default_rng(7))
    first, second = matched(anchor(), run), matched(anchor(), again)
    assert [(one.t_s, one.axis_m, one.bound_m) for one in first] == [
        (one.t_s, one.axis_m, one.bound_m) for one in second
    ]
