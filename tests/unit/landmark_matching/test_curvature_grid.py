"""The grid filter: it follows a way, keeps what it cannot tell apart, and sums to one."""

from __future__ import annotations

import numpy as np
import pytest

from services.landmark_matching.curvature_grid import CurvatureGrid
from services.landmark_matching.curvature_route import STEP_M, Route

PLACES = np.arange(0.0, 3001.0, STEP_M)


def route(branch: str, curve_at_m: float) -> Route:
    """A route with one curve of 200 m, radius 400 m."""
    curvature = np.where((curve_at_m <= PLACES) & (curve_at_m + 200.0 > PLACES), 1.0 / 400.0, 0.0)
    heading = np.concatenate([[0.0], np.cumsum(0.5 * (curvature[1:] + curvature[:-1]))])
    return Route(branch, "up", 0.0, heading)


def walked(grid: CurvatureGrid, begin_m: float, end_m: float, curve_at_m: float) -> None:
    """Steps of 10 m with the exact curvature of a 30 m window."""
    one = route("", curve_at_m)
    for place in np.arange(begin_m + 10.0, end_m, 10.0):
        grid.move(10.0)
        a, b = (float(np.interp(place + side, PLACES, one.heading_rad)) for side in (-15.0, 15.0))
        grid.weigh((b - a) / 30.0, 30.0, 1.0 / 3.0)


def test_a_curve_tells_the_place() -> None:
    grid = CurvatureGrid([route("", 1000.0)])
    walked(grid, 800.0, 1400.0, 1000.0)
    which, place_m = grid.best()
    probability, mean_m = grid.near(which, place_m, 60.0)
    assert mean_m == pytest.approx(1390.0, abs=20.0)  # the filter is good to some ten metres
    assert probability > 0.99


def test_chances_sum_to_one_and_the_right_way_wins() -> None:
    grid = CurvatureGrid([route("", 1000.0), route("b", 1150.0)])
    grid.expect([(780.0, 820.0), (780.0, 820.0)])
    assert grid.route_chances() == pytest.approx([0.5, 0.5])
    walked(grid, 800.0, 1500.0, 1150.0)
    chances = grid.route_chances()
    assert sum(chances) == pytest.approx(1.0)
    assert chances[1] > 0.9999


def test_ways_alike_stay_undecided() -> None:
    grid = CurvatureGrid([route("", 1000.0), route("b", 1000.0)])
    grid.expect([(780.0, 820.0), (780.0, 820.0)])
    walked(grid, 800.0, 1500.0, 1000.0)
    assert grid.route_chances() == pytest.approx([0.5, 0.5])


def test_a_ruled_out_route_stays_ruled_out() -> None:
    grid = CurvatureGrid([route("", 1000.0), route("b", 1000.0)])
    grid.expect([(780.0, 820.0), None])
    walked(grid, 800.0, 1200.0, 1000.0)
    assert grid.route_chances()[1] == 0.0


def test_beyond_every_end_the_place_is_lost() -> None:
    grid = CurvatureGrid([route("", 1000.0)])
    grid.expect([(2900.0, 2950.0)])
    grid.move(500.0)
    assert grid.lost
