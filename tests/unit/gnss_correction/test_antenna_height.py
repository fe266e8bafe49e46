"""An antenna above the rail: the axis lifted, and what the method line then says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from services.gnss_correction.antenna_height import raised
from services.gnss_correction.line_method import Line, LineInput, LineMethod
from services.gnss_correction.rejection import Outcome
from services.gnss_correction.solver_arrays import no_solutions
from services.numerics.geodesy import geodetic_from_ecef
from tests.unit.gnss_correction.made_up_line import H_M, LAT_DEG, RULES_HERE, bend, geometry, rows_at

ABOVE_M = 12.0
"""Far above any roof, so that it shows."""


def test_points_are_lifted_and_lengths_kept() -> None:
    axis = bend()
    lifted = raised(axis, ABOVE_M)
    assert np.array_equal(lifted.axis_m, axis.axis_m)
    ends = [geodetic_from_ecef(*one.at(np.array([0.0, axis.length_m])).T) for one in (axis, lifted)]
    # Both ends are vertices; Bowring's solution is good to nanometres.
    assert ends[1][2] - ends[0][2] == pytest.approx([ABOVE_M, ABOVE_M], abs=1e-6)
    assert ends[1][0] == pytest.approx(ends[0][0], abs=1e-13)
    assert ends[1][1] == pytest.approx(ends[0][1], abs=1e-13)


def test_an_antenna_at_the_lines_own_height_needs_nothing() -> None:
    axis = bend()
    assert raised(axis, 0.0) is axis


def standing(line: Line) -> tuple[float, float, float]:
    """Height, error of the chainage and latitude of the fix; the antenna is ABOVE_M over the rail, 500 m along it."""
    place_m = raised(line.geometry.axis, ABOVE_M).at(500.0)
    epochs = 40
    rows = [rows_at(place_m, np.zeros(3), clock_m=50.0) for _ in range(epochs)]
    free = no_solutions(epochs)
    free["outcome"] = Outcome.TOO_FEW_SATELLITES
    t_s = 0.2 * np.arange(epochs)
    given = LineInput(
        np.arange(0, 10 * epochs + 1, 10),
        np.asarray(t_s + 200_000.0),
        np.asarray(t_s + 1e9),
        np.zeros(epochs, bool),
        np.concatenate(rows),
        free,
    )
    solution = LineMethod(line).solve(given, RULES_HERE[0])[0][-1]
    return float(solution["h_m"]), abs(float(solution["chainage_m"]) - 10_500.0), float(solution["lat_rad"])


def test_the_fix_is_that_of_the_antenna() -> None:
    line = Line(geometry(bend()), antenna_above_m=ABOVE_M)
    height_m, error_m, lat_rad = standing(line)
    # Half a cell of the grid along the line; the plane of the made-up line is curved by 2 cm in 500 m.
    assert error_m < 0.5
    assert height_m == pytest.approx(H_M + ABOVE_M, abs=0.1)
    assert np.degrees(lat_rad) == pytest.approx(LAT_DEG, abs=1e-6)
    assert standing(replace(line, antenna_above_m=0.0))[0] == pytest.approx(H_M, abs=0.1)
