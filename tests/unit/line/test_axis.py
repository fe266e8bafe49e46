"""Axes: lengths, points and directions."""

from __future__ import annotations

import numpy as np
import pytest

from services.line.axis import AxisError, axis_of
from services.numerics.geodesy import ecef_from_geodetic


def test_length_along_a_meridian_is_that_of_the_ellipsoid() -> None:
    # From 50.0 to 50.1 degrees: 11 123.0 m by the meridian's radius of curvature, 6 372 956 m at 50.05 degrees.
    lat = np.linspace(50.0, 50.1, 101)
    axis = axis_of(lat, np.full(101, 10.0), np.zeros(101))
    radius_m = 6378137.0 * (1 - 0.00669437999) / (1 - 0.00669437999 * np.sin(np.radians(50.05)) ** 2) ** 1.5
    # The radius changes by 1e-6 over the arc, and chords of 111 m are 1e-9 too short.
    assert axis.length_m == pytest.approx(np.radians(0.1) * radius_m, rel=1e-6)


def test_points_and_tangents_at_the_vertices_and_beyond() -> None:
    axis = axis_of([0.0, 0.0, 0.001], [0.0, 0.001, 0.001], [0.0, 0.0, 0.0])
    start = np.array(ecef_from_geodetic(0.0, 0.0, 0.0))
    assert np.allclose(axis.at(0.0), start)
    assert np.allclose(axis.at(-50.0), start)
    assert axis.tangent(50.0) @ [0.0, 1.0, 0.0] == pytest.approx(1.0, abs=1e-6)
    assert axis.tangent(axis.length_m) @ [0.0, 0.0, 1.0] == pytest.approx(1.0, abs=1e-6)


def test_repeated_vertices_are_left_out_and_remembered() -> None:
    axis = axis_of([0.0, 0.0, 0.0], [0.0, 0.0, 0.001], [0.0, 0.0, 0.0])
    assert axis.vertex.tolist() == [0, 2]


@pytest.mark.parametrize(
    ("lat", "lon", "words"),
    [
        ([0.0], [0.0], "two different vertices"),
        ([0.0, 0.0], [0.0, 0.0], "two different vertices"),
        ([0.0, 95.0], [0.0, 0.0], "vertex 2: latitude 95"),
        ([0.0, 1.0], [0.0, 0.0], "vertex 2: 111 km"),
        ([0.0, np.nan], [0.0, 0.0], "vertex 2"),
    ],
)
def test_what_is_no_axis_is_refused(lat: list[float], lon: list[float], words: str) -> None:
    with pytest.raises(AxisError, match=words):
        axis_of(lat, lon, np.zeros(len(lat)))
