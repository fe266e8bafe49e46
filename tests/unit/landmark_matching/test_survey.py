"""Surveys: fitted curves, runs laid onto the line, and the database that comes of them."""

from __future__ import annotations

import math
from functools import cache

import msgspec
import numpy as np
import pytest

from services.landmark_matching.curve_fit import fit_curve
from services.landmark_matching.curve_shape import CurveShape, mean_curvature, shape_of_landmark
from services.landmark_matching.line_landmarks import DatabaseError, line_landmarks
from services.landmark_matching.run_matching import match_run
from services.landmark_matching.settings import MatchSettings
from services.landmark_matching.survey import SURVEY, database_of, survey_run
from services.landmark_matching.survey_alignment import align
from services.landmark_matching.survey_merge import Surveyed, SurveyedLandmark, merge
from tests.unit.landmark_matching.demo_runs import demo_landmarks, demo_line, demo_run, true_axis


@cache
def surveyed() -> tuple[SurveyedLandmark, ...]:
    found = []
    for seed, speed in enumerate((12.0, 15.0, 18.0)):
        readings, _ = demo_run("up", 300.0, 6000.0, speed_mps=speed, wheel_scale=1.0 + 0.004 * seed, seed=seed)
        found += survey_run(f"run{seed}", match_run(readings, demo_landmarks(), None, SURVEY, 0.02))
    return tuple(merge(found))


def test_a_curve_is_fitted_exactly_where_there_is_no_noise() -> None:
    true = CurveShape(1000.0, 1050.0, 1170.0, 1230.0, -1.0 / 400.0)
    place = np.arange(950.0, 1300.0, 1.5)
    speed, window = np.full(len(place), 15.0), np.full(len(place), 30.0)
    measured = mean_curvature(true, place, window) + 5e-4 / speed
    fit = fit_curve(CurveShape(1008.0, 1040.0, 1185.0, 1220.0, -1.0 / 450.0), place, measured, window, speed)
    assert fit is not None
    assert fit.shape.start_m == pytest.approx(true.start_m, abs=0.05)
    assert fit.shape.end_m == pytest.approx(true.end_m, abs=0.05)
    assert fit.shape.curvature_per_m == pytest.approx(true.curvature_per_m, rel=1e-4)
    assert fit.bias_radps == pytest.approx(5e-4, rel=1e-2)


def test_one_curve_that_the_line_has_wrong_is_held_by_its_neighbours() -> None:
    distance = np.arange(0.0, 8000.0, 1000.0)
    place = 500.0 + 1.01 * distance
    place[4] += 12.0
    found = align(distance, place, np.full(8, 10.0), np.zeros(8))
    errors = distance + found.offset_m - (500.0 + 1.01 * distance)
    assert abs(errors[4]) < 5.0  # of twelve
    assert found.scale == pytest.approx(1.01, abs=0.002)


def test_a_slip_moves_only_what_lies_behind_it() -> None:
    distance = np.arange(0.0, 8000.0, 1000.0)
    excess = np.where(distance >= 4000.0, 30.0, 0.0)
    place = distance + np.where(distance >= 4000.0, 15.0, 0.0)
    found = align(distance, place, np.full(8, 3.0), excess)
    assert np.abs(distance + found.offset_m - place).max() < 1.0  # the step is left to the slip


def test_surveyed_places_are_the_line_s_within_the_accuracy_stated() -> None:
    found = surveyed()
    truth = {one.id: one for one in demo_landmarks().landmarks[""]}
    assert len(found) >= 4
    for one in found:
        row, wanted = one.landmark, truth[one.landmark.id]
        error_m = row.exit_lower_limit_m - wanted.exit_lower_limit_m
        assert abs(error_m) <= min(row.accuracy_m, 2.0)  # crossings spread by 1 m, three runs are averaged
        assert row.radius_m == pytest.approx(wanted.radius_m, rel=0.02)
        assert row.runs == 3
        assert row.spread_m is not None


def passage(run: str, *, exit_m: float = 0.0, radius: float = 1.0) -> Surveyed:
    """Of one landmark; its places are those of the line but for a shift and another radius."""
    landmark = demo_landmarks().landmarks[""][0]
    shape = shape_of_landmark(landmark)
    places = (shape.start_m, shape.arc_start_m, shape.arc_end_m, shape.end_m)
    start, arc_start, arc_end, end = (place + exit_m for place in places)
    moved = CurveShape(start, arc_start, arc_end, end, shape.curvature_per_m / radius)
    return Surveyed(landmark, run, moved, 0.5, 0.02, 15.0)


@pytest.mark.parametrize("bad", [passage("bad", exit_m=9.0), passage("bad", radius=0.9)])
def test_one_bad_run_among_good_ones_is_left_out(bad: Surveyed) -> None:
    good = [passage("a", exit_m=-0.4), passage("b", exit_m=0.4), passage("c")]
    (merged,) = merge([good[0], bad, *good[1:]])
    assert [one.run for one in merged.left_out] == ["bad"]
    assert merged.landmark == merge(good)[0].landmark
    assert merged.landmark.runs == 3


def test_of_two_runs_that_disagree_neither_is_left_out_and_the_accuracy_says_so() -> None:
    (merged,) = merge([passage("a", exit_m=-6.0), passage("b", exit_m=6.0)])
    assert merged.left_out == ()
    assert merged.landmark.accuracy_m >= 6.0  # either may be right


def test_few_runs_that_agree_by_chance_do_not_promise_more_than_crossings_spread() -> None:
    accuracy = [merge([passage(f"{k}") for k in range(count)])[0].landmark.accuracy_m for count in (1, 3, 30)]
    # 0.7 m + 3 sqrt(s²/n + 0.5²) with s² = 2 · 1.5² / (n + 1), the runs' own spread being none
    stated = [0.7 + 3.0 * math.sqrt(4.5 / (count + 1) / count + 0.25) for count in (1, 3, 30)]
    assert accuracy == pytest.approx(stated, abs=0.006)  # the file has centimetres


def test_the_database_names_its_evidence_and_is_the_same_each_time() -> None:
    database = database_of(surveyed(), demo_landmarks())
    assert database.evidence == ("run0", "run1", "run2")
    assert database.line_version == demo_line().version
    assert database.version == database_of(surveyed(), demo_landmarks()).version
    assert database.version != database_of(surveyed()[:1], demo_landmarks()).version


def test_a_surveyed_database_matches_a_further_run() -> None:
    known = line_landmarks(demo_line(), database_of(surveyed(), demo_landmarks()))
    readings, axis_m = demo_run("up", 300.0, 6000.0, speed_mps=17.0, wheel_scale=0.99, seed=9)
    found = match_run(readings, known, None, MatchSettings(), 0.02)
    assert all(match.accepted for match in found.matches)
    assert all(abs(match.axis_m - true_axis(match.t_s, axis_m)) <= match.bound_m for match in found.matches)


def test_a_landmark_beyond_the_line_s_end_is_refused() -> None:
    row = demo_landmarks().landmarks[""][0]
    far = msgspec.structs.replace(row, exit_lower_limit_m=9e8, exit_straight_start_m=1e9, exit_straight_end_m=2e9)
    database = msgspec.structs.replace(database_of(surveyed()[:1], demo_landmarks()), landmarks=(far,))
    with pytest.raises(DatabaseError, match="beyond the line's end"):
        line_landmarks(demo_line(), database)


@pytest.mark.parametrize(("field", "words"), [("line_version", "version '2025-9'"), ("line", "line '2025-9'")])
def test_a_database_of_another_line_or_version_is_refused(field: str, words: str) -> None:
    database = msgspec.structs.replace(database_of(surveyed()[:1], demo_landmarks()), **{field: "2025-9"})
    with pytest.raises(DatabaseError, match=words):
        line_landmarks(demo_line(), database)
