"""The method line in blocks, and fixes of other methods placed on the line."""

from __future__ import annotations

import math

import numpy as np
import pytest

from services.gnss_correction.line_method import LINE_SOLUTION, Line, LineInput, LineMethod, LinePlacing, warm_up
from services.gnss_correction.pipeline import Correction
from services.gnss_correction.rejection import Outcome
from services.gnss_correction.settings import Config
from services.gnss_correction.solver_arrays import SOLUTION, no_solutions
from services.numerics.geodesy import geodetic_from_ecef
from tests.unit.gnss_correction.made_up_line import RULES_HERE, bend, geometry, rows_at, there_and_back

LINE = geometry(bend())


def given(first: int, last: int) -> LineInput:
    """Epochs `first` to `last` of a run at 15 m/s from 300 m on, five per second."""
    t_s = np.asarray(np.arange(first, last) * 0.2, np.float64)
    axis_m = 300.0 + 15.0 * t_s
    rows = [rows_at(LINE.axis.at(s), 15.0 * LINE.axis.tangent(s), clock_m=50.0) for s in axis_m]
    first_row = np.concatenate([[0], np.cumsum([len(one) for one in rows])])
    free = no_solutions(len(t_s))
    free["outcome"] = Outcome.TOO_FEW_SATELLITES
    refused = np.zeros(len(t_s), bool)
    return LineInput(first_row, np.add(t_s, 200_000.0), np.add(t_s, 1e9), refused, np.concatenate(rows), free)


def test_fixes_lie_on_the_line_and_have_its_kilometrage() -> None:
    solutions, reasons = LineMethod(Line(LINE)).solve(given(0, 20), RULES_HERE[0])
    assert solutions.dtype == LINE_SOLUTION
    assert reasons == [""] * 20
    assert (solutions["outcome"] == Outcome.FIX).all()
    # The first second's fixes are good to some metres, later ones to the grid.
    assert np.abs(solutions["chainage_m"] - (10_300.0 + 3.0 * np.arange(20)))[10:].max() < 1.5
    assert np.allclose(np.hypot(solutions["ve_mps"], solutions["vn_mps"]), solutions["speed_along_mps"], atol=0.05)
    assert (solutions["bound_m"] > solutions["chainage_bound_m"]).all()


def test_the_division_into_blocks_does_not_matter() -> None:
    whole, _ = LineMethod(Line(LINE)).solve(given(0, 20), RULES_HERE[0])
    follower = LineMethod(Line(LINE))
    parts = [follower.solve(given(first, first + 4), RULES_HERE[0])[0] for first in range(0, 20, 4)]
    assert np.concatenate(parts).tobytes() == whole.tobytes()


def test_a_clock_set_back_starts_anew() -> None:
    follower = LineMethod(Line(LINE))
    follower.solve(given(10, 20), RULES_HERE[0])
    again, _ = follower.solve(given(0, 10), RULES_HERE[0])
    fresh, _ = LineMethod(Line(LINE)).solve(given(0, 10), RULES_HERE[0])
    assert again.tobytes() == fresh.tobytes()


def test_the_method_needs_a_line() -> None:
    with pytest.raises(ValueError, match="needs a line"):
        Correction(Config(method="line"), ("line",))


def test_warming_up_says_nothing() -> None:
    warm_up(Line(LINE))


def fixes(east_north: list[tuple[float, float]], axis_geometry: object, velocity: tuple[float, float]) -> np.ndarray:
    """Fixes of another method at places in the plane of a line."""
    dtype = np.dtype([*SOLUTION.descr, ("bound_m", np.float64)])
    solutions = np.zeros(len(east_north), dtype)
    axis = axis_geometry.axis  # type: ignore[attr-defined] # any line
    origin = axis.ecef_m[0]
    lat, lon, _ = geodetic_from_ecef(*origin)
    east = np.array([-math.sin(lon), math.cos(lon), 0.0])
    up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    north = np.cross(up, east)
    for solution, (e, n) in zip(solutions, east_north, strict=True):
        solution["lat_rad"], solution["lon_rad"], solution["h_m"] = geodetic_from_ecef(*(origin + e * east + n * north))
        solution["ve_mps"], solution["vn_mps"] = velocity
        solution["bound_m"] = 20.0
    return solutions


def test_other_fixes_are_projected_onto_the_line() -> None:
    placed = LinePlacing(LINE).place(fixes([(100.0, 7.0), (110.0, -3.0)], LINE, (12.0, 0.0)), np.array([0.0, 1.0]))
    assert placed["chainage_m"] == pytest.approx([10_100.0, 10_110.0], abs=0.2)
    assert placed["chainage_bound_m"] == pytest.approx([20.0, 20.0])
    assert placed["speed_along_mps"] == pytest.approx([12.0, 12.0], abs=0.05)


def test_a_fix_far_from_the_line_has_no_chainage() -> None:
    placed = LinePlacing(LINE).place(fixes([(100.0, 900.0)], LINE, (0.0, 0.0)), np.array([0.0]))
    assert np.isnan(placed["chainage_m"]).all()


def test_a_fix_between_two_passages_is_bounded_by_both() -> None:
    loop = geometry(there_and_back())
    eastwards = LinePlacing(loop).place(fixes([(100.0, 2.5)], loop, (10.0, 0.0)), np.array([0.0]))
    westwards = LinePlacing(loop).place(fixes([(100.0, 1.5)], loop, (-10.0, 0.0)), np.array([0.0]))
    assert eastwards["chainage_m"][0] == pytest.approx(10_100.0, abs=0.5)
    assert westwards["chainage_m"][0] - eastwards["chainage_m"][0] > 400.0
    assert eastwards["chainage_bound_m"][0] > 400.0
