from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.simulator.line_shape import Element, LineShape, LineShapeError

# Lengths are integrated to below a micrometre; the rest is rounding of coordinates of some km.
EXACT_M = 1e-6


def shape() -> LineShape:
    return LineShape(
        [
            Element(length_m=500.0),
            Element(length_m=350.0, radius_m=400.0, transition_m=60.0),
            Element(length_m=100.0),
            Element(length_m=300.0, radius_m=-300.0, transition_m=50.0),
        ],
        heading_rad=0.3,
    )


def test_a_straight_goes_where_it_points() -> None:
    here = LineShape([Element(length_m=1000.0)], heading_rad=np.pi / 6).at(600.0)
    assert here.x_m[0] == pytest.approx(600 * np.cos(np.pi / 6), abs=EXACT_M)
    assert here.y_m[0] == pytest.approx(300.0, abs=EXACT_M)
    assert here.curvature_per_m[0] == 0.0


def test_a_left_arc_ends_on_its_circle() -> None:
    quarter = LineShape([Element(length_m=np.pi / 2 * 400.0, radius_m=400.0)], heading_rad=0.0)
    end = quarter.at(quarter.length_m)
    assert (end.x_m[0], end.y_m[0]) == pytest.approx((400.0, 400.0), abs=EXACT_M)
    assert end.heading_rad[0] == pytest.approx(np.pi / 2)
    assert quarter.at(10.0).curvature_per_m[0] == pytest.approx(1 / 400)


def test_a_transition_is_a_clothoid() -> None:
    length, radius = 80.0, 300.0
    curve = LineShape([Element(length_m=160.0, radius_m=radius, transition_m=length)], heading_rad=0.0)
    end = curve.at(length)
    # Series of the Fresnel integrals about the start; the terms left out are below 1e-7 m.
    angle = length / (2 * radius)
    x = length * (1 - angle**2 / 10 + angle**4 / 216 - angle**6 / 9360)
    y = length * (angle / 3 - angle**3 / 42 + angle**5 / 1320)
    assert (end.x_m[0], end.y_m[0]) == pytest.approx((x, y), abs=EXACT_M)
    assert end.heading_rad[0] == pytest.approx(angle)
    assert end.curvature_per_m[0] == pytest.approx(1 / radius)


@given(st.floats(-50.0, 1300.0))
def test_axis_metres_are_true_metres_in_the_direction_of_the_heading(axis_m: float) -> None:
    step = 0.01
    points = shape().at(np.array([axis_m - step / 2, axis_m, axis_m + step / 2]))
    moved = np.array([points.x_m[2] - points.x_m[0], points.y_m[2] - points.y_m[0]]) / step
    heading = points.heading_rad[1]
    # A chord of 1 cm on a radius of 300 m; coordinates of 1 km rounded at 1e-13 m.
    assert moved == pytest.approx([np.cos(heading), np.sin(heading)], abs=1e-6)


def test_beyond_the_end_it_goes_straight_on() -> None:
    line = shape()
    end, on = line.at(line.length_m), line.at(line.length_m + 100.0)
    assert np.hypot(on.x_m - end.x_m, on.y_m - end.y_m)[0] == pytest.approx(100.0, abs=EXACT_M)
    assert on.heading_rad[0] == end.heading_rad[0]


@pytest.mark.parametrize(
    "elements",
    [
        [],
        [Element(length_m=0.0)],
        [Element(length_m=100.0, radius_m=0.0)],
        [Element(length_m=100.0, radius_m=300.0, transition_m=51.0)],
        [Element(length_m=1000.0, radius_m=300.0)],
    ],
)
def test_what_is_no_line_is_refused(elements: list[Element]) -> None:
    with pytest.raises(LineShapeError):
        LineShape(elements, heading_rad=0.0)
