"""Hills, braking and accelerating again, differences, reception, departures from a reference, on drawn speeds."""

from __future__ import annotations

import numpy as np
import pytest

from services.run_history.driving_difference import difference_of, hills_of, reaccelerations
from services.run_history.reception_survey import survey
from services.run_history.reference_departure import departures
from services.run_history.speed_trace import grid_over, population, speeds_on
from tests.unit.run_history.run_examples import trace

GRID = grid_over(4000.0)
CORNERS = (0.0, 800.0, 1500.0, 2500.0, 4000.0)
"""Up to the first hill at 800 m, down to the restriction at 1500 m, up to 2500 m, down to the stop."""


def two_hills(first: float, second: float, low: float = 10.0) -> tuple[float, ...]:
    return (0.0, first, low, second, 0.0)


def test_speeds_on_a_grid_go_straight_between_fixes() -> None:
    speeds = speeds_on(trace(1, CORNERS, two_hills(20.0, 25.0)), GRID)
    assert speeds[40] == pytest.approx(10.0)  # halfway up the first hill
    assert speeds[150] == pytest.approx(10.0)
    assert speeds[-1] == 0.0


def test_the_spread_of_the_end_of_acceleration_is_told_for_each_hill() -> None:
    speeds = population([trace(k, CORNERS, two_hills(18.0 + k, 25.0)) for k in range(5)], GRID)
    hills = hills_of(speeds, GRID)
    assert [(hill.start_m, hill.end_m) for hill in hills] == [(0.0, 1500.0), (1500.0, 4000.0)]
    assert [hill.spread_mps for hill in hills] == [pytest.approx(4.0), pytest.approx(0.0)]
    assert hills_of(np.zeros((0, len(GRID))), GRID) == []


def test_braking_and_accelerating_again_is_found_where_others_do_not() -> None:
    plain = [trace(k, CORNERS, two_hills(20.0, 25.0)) for k in range(4)]
    again = trace(9, (0.0, 800.0, 1500.0, 2500.0, 3200.0, 3400.0, 4000.0), (0.0, 20.0, 10.0, 25.0, 12.0, 17.0, 0.0))
    found = reaccelerations(population([*plain, again], GRID), GRID)
    assert [len(one) for one in found] == [0, 0, 0, 0, 1]  # the restriction at 1500 m is everybody's
    (dip,) = found[4]
    assert dip.at_m == 3200.0
    assert (dip.from_mps, dip.low_mps, dip.to_mps) == pytest.approx((25.0, 12.0, 17.0))


def test_alone_a_run_has_no_habits() -> None:
    assert reaccelerations(population([trace(1, CORNERS, two_hills(20.0, 25.0))], GRID), GRID) == [()]


def test_the_energy_saving_run_is_set_against_the_others() -> None:
    speeds = population(
        [trace(1, CORNERS, two_hills(18.0, 20.0, low=12.0))]
        + [trace(k, CORNERS, two_hills(20.0, 25.0)) for k in (2, 3, 4)],
        GRID,
    )
    limit = np.where((GRID > 1400.0) & (GRID < 1600.0), 14.0, 30.0)
    found = difference_of(speeds, GRID, 0, limit, reaccelerations(speeds, GRID))
    assert (found.top_mps, found.top_others_mps) == pytest.approx((20.0, 25.0))
    assert found.limited_mps is not None
    assert found.limited_others_mps is not None
    assert found.limited_mps > found.limited_others_mps
    assert found.approach_mps == pytest.approx(20.0 / 3.0)
    assert difference_of(speeds, GRID, 0, None, ((),)).limited_mps is None
    assert difference_of(speeds, GRID, 0, np.full(len(GRID), np.inf), ((),)).limited_mps is None


def test_reception_is_told_where_fixes_and_speeds_are_missing() -> None:
    t = np.array([*range(20), *range(30, 50)], float)
    axis = 25.0 * t
    speed = np.where(t < 5, np.nan, 25.0)
    found = {one.start_axis_m: one for one in survey([(t, axis, speed)])}
    assert found[0.0].without_speed == 5
    assert found[0.0].without_speed_share == pytest.approx(0.5)
    # From 19 s to 30 s ten fixes are missing, one a second; the train was at 475 m.
    assert found[250.0].missing_s == pytest.approx(10.0)
    assert found[250.0].longest_gap_s == pytest.approx(10.0)
    assert sum(one.missing_s for one in found.values()) == pytest.approx(10.0)
    assert sum(one.fixes for one in found.values()) == len(t)


def test_a_run_off_the_line_is_no_reception() -> None:
    t = np.arange(10.0)
    assert survey([(t, np.full(10, np.nan), np.ones(10))]) == []


def test_places_where_logs_repeatedly_leave_the_reference_are_named() -> None:
    truth = trace(1, (0.0, 1000.0, 3000.0, 4000.0), (0.0, 20.0, 20.0, 0.0))
    off = trace(1, (0.0, 1000.0, 1990.0, 2050.0, 2110.0, 3000.0, 4000.0), (0.0, 20.0, 20.0, 22.0, 20.0, 20.0, 0.0))
    good = [(truth, truth)]
    (found,) = departures([(off, truth), (off, truth), *good], 4000.0)
    assert (found.start_m, found.end_m) == (2000.0, 2100.0)
    assert (found.runs, found.of_runs) == (2, 3)
    assert found.largest_mps == pytest.approx(2.0)
    assert departures([(off, truth), *good, *good], 4000.0) == []  # once is not repeatedly
    assert departures([], 4000.0) == []
