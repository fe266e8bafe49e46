"""Figures of the tables against closed values."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.gnss_correction.evaluation import (
    FixTrack,
    Polyline,
    distances_to_line_m,
    evaluate,
    line_distance,
    truth_error,
)
from services.gnss_correction.evaluation_table import tables

DEGREE_M = math.pi / 180.0 * 6_378_137.0
"""Of longitude along the equator."""


def along_equator(east_m: list[float], at: list[float]) -> Polyline:
    zeros = np.zeros(len(east_m))
    return Polyline(zeros, np.array(east_m) / DEGREE_M, zeros, np.array(at))


def track(name: str, t_s: list[float], east_m: list[float], north_m: list[float]) -> FixTrack:
    """Fixes by the equator; NaN for none."""
    east, north = np.array(east_m), np.array(north_m)
    # A degree of latitude at the equator is (1 - e²) of one of longitude.
    lat_deg = north / (DEGREE_M * (1.0 - 6.69437999014e-3))
    return FixTrack(name, np.array(t_s), np.isfinite(east), lat_deg, east / DEGREE_M, np.zeros(len(east)))


LINE = along_equator([0.0, 50.0, 100.0], [0.0, 50.0, 100.0])
TRUTH = along_equator([0.0, 10.0, 20.0, 30.0, 40.0], [0.0, 1.0, 2.0, 5.0, 6.0])
NAN = math.nan


def test_distances_to_a_line_with_a_bend() -> None:
    line = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    points = np.array([[5.0, -2.0], [13.0, 5.0], [12.0, -1.0], [-3.0, -4.0], [8.0, 2.0]])
    np.testing.assert_allclose(distances_to_line_m(points, line), [2.0, 3.0, math.sqrt(5.0), 5.0, 2.0])


@given(
    points=st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=1, max_size=5),
    line=st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=2, max_size=6),
)
def test_no_point_of_a_line_is_nearer_than_its_distance(
    points: list[tuple[float, float]], line: list[tuple[float, float]]
) -> None:
    vertices = np.array(line)
    distances = distances_to_line_m(np.array(points), vertices)
    share = np.linspace(0.0, 1.0, 11)[:, None]
    on_line = np.vstack([a + share * (b - a) for a, b in pairwise(vertices)])
    for point, distance in zip(points, distances, strict=True):
        # A piece shorter than a micrometre counts as its first end.
        assert distance <= np.linalg.norm(on_line - point, axis=1).min() + 1e-6


def test_table_1_has_the_papers_four_figures() -> None:
    found = line_distance(track("a", [0, 1, 2, 3], [10.0, 20.0, NAN, 30.0], [3.0, -1.0, NAN, 8.0]), LINE)
    assert found is not None
    # Millimetres: the local plane falls away from the curved Earth by less.
    assert found.average_m == pytest.approx(4.0, abs=1e-3)
    assert found.maximum_m == pytest.approx(8.0, abs=1e-3)
    assert found.minimum_m == pytest.approx(1.0, abs=1e-3)
    assert found.standard_deviation_m == pytest.approx(math.sqrt((1.0 + 9.0 + 16.0) / 3.0), abs=1e-3)


def test_errors_against_the_truth_are_counted_inside_it_alone() -> None:
    #        before  edge    between  in the gap  by the gap  after
    t_s = [-1.0, -0.05, 0.5, 3.5, 4.95, 7.0]
    east = [0.0, 3.0, 5.0, 25.0, 30.0, 40.0]
    north = [0.0, 4.0, 0.0, 50.0, 12.0, 0.0]
    found = truth_error(track("a", t_s, east, north), TRUTH)
    assert found is not None
    assert found.epochs == 3
    assert found.fixation_percent == 100.0
    # At 4.95 s the truth is interpolated to 29.833 m; millimetres as above.
    errors = sorted([5.0, 0.0, math.hypot(30.0 - (20.0 + 10.0 * 2.95 / 3.0), 12.0)])
    assert found.mean_m == pytest.approx(np.mean(errors), abs=1e-3)
    assert found.p50_m == pytest.approx(errors[1], abs=1e-3)
    assert found.p95_m == pytest.approx(np.percentile(errors, 95), abs=1e-3)
    assert found.maximum_m == pytest.approx(errors[2], abs=1e-3)


def test_epochs_without_a_fix_lower_the_rate() -> None:
    found = evaluate(track("a", [0.0, 1.0, 2.0, 9.0], [0.0, NAN, NAN, 5.0], [0.0, NAN, NAN, 5.0]), TRUTH, LINE)
    assert found.epochs == 4
    assert found.fixation_percent == 50.0
    assert found.truth is not None
    assert found.truth.epochs == 3
    assert found.truth.fixation_percent == pytest.approx(100.0 / 3.0)


def test_nothing_to_compare_gives_nothing() -> None:
    nowhere = track("a", [0.0, 1.0], [NAN, NAN], [NAN, NAN])
    found = evaluate(nowhere, TRUTH, LINE)
    assert (found.line, found.truth, found.fixation_percent) == (None, None, 0.0)
    assert evaluate(track("a", [0.0], [1.0], [1.0]), None, None).truth is None


def test_the_tables_stand_side_by_side() -> None:
    first = evaluate(track("original", [0.0, 1.0], [0.0, 10.0], [3.0, 5.0]), TRUTH, LINE)
    second = evaluate(track("remove", [0.0, 1.0], [NAN, NAN], [NAN, NAN]), TRUTH, LINE)
    assert tables([first, second], with_line=True, with_truth=True) == (
        "Table 1: distance to the line [m]\n"
        "                    original  remove\n"
        "------------------------------------\n"
        "average                4.000       -\n"
        "maximum                5.000       -\n"
        "minimum                3.000       -\n"
        "standard deviation     1.000       -\n"
        "\n"
        "Table 2: fixation rate\n"
        "                original  remove\n"
        "--------------------------------\n"
        "epochs                 2       2\n"
        "with a fix [%]   100.000   0.000\n"
        "\n"
        "Horizontal error against the truth [m]\n"
        "                         original  remove\n"
        "-----------------------------------------\n"
        "epochs inside the truth         2       -\n"
        "with a fix [%]            100.000       -\n"
        "mean                        4.000       -\n"
        "50 %                        4.000       -\n"
        "95 %                        4.900       -\n"
        "maximum                     5.000       -"
    )
