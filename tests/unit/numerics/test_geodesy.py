"""WGS 84 against known values and back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.numerics.geodesy import (
    WGS84_A_M,
    WGS84_B_M,
    ecef_from_geodetic,
    elevation_azimuth,
    enu_about,
    enu_from_ecef_rotation,
    geodetic_from_ecef,
)


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "expected"),
    [(0.0, 0.0, (WGS84_A_M, 0.0, 0.0)), (0.0, 90.0, (0.0, WGS84_A_M, 0.0)), (90.0, 0.0, (0.0, 0.0, WGS84_B_M))],
)
def test_axes_end_at_the_axes(lat_deg: float, lon_deg: float, expected: tuple[float, float, float]) -> None:
    # A nanometre is the rounding of the cosine of a right angle times the radius.
    np.testing.assert_allclose(
        ecef_from_geodetic(math.radians(lat_deg), math.radians(lon_deg), 0.0), expected, atol=1e-9
    )


@given(lat=st.floats(-math.pi / 2, math.pi / 2), lon=st.floats(-3.14, 3.14), h=st.floats(-5_000.0, 3e7))
def test_there_and_back(lat: float, lon: float, h: float) -> None:
    x, y, z = ecef_from_geodetic(lat, lon, h)
    lat2, lon2, h2 = geodetic_from_ecef(x, y, z)
    # In metres on the ground: 1e-8 m is the rounding of coordinates of 3e7 m.
    assert (lat2 - lat) * (WGS84_A_M + h) == pytest.approx(0.0, abs=1e-7)
    assert h2 == pytest.approx(h, abs=1e-7)
    if abs(lat) < 1.5:
        assert lon2 == pytest.approx(lon, abs=1e-14)


def test_the_centre_of_the_earth_is_no_trouble() -> None:
    lat, lon, h = geodetic_from_ecef(0.0, 0.0, 0.0)
    assert (lat, lon, h) == (0.0, 0.0, -WGS84_A_M)


def test_local_axes_point_where_they_should() -> None:
    rotation = enu_from_ecef_rotation(0.0, 0.0)
    np.testing.assert_allclose(rotation @ [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(rotation @ [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)


def test_metres_about_a_reference() -> None:
    reference = (45.0, 10.0, 100.0)
    east, north, up = enu_about(reference, 45.0, 10.0, 130.0)
    # Cancellation of 6e6 m leaves nanometres.
    assert (east, north, up) == (
        pytest.approx(0.0, abs=1e-8),
        pytest.approx(0.0, abs=1e-8),
        pytest.approx(30.0, abs=1e-8),
    )
    points = enu_about(reference, [45.0, 45.001], [10.0, 10.0], [100.0, 100.0])
    # A thousandth of a degree of the meridian at 45° is 111.13 m.
    assert points[1, 1] == pytest.approx(111.13, abs=0.01)


def test_directions() -> None:
    receiver = np.array(ecef_from_geodetic(0.0, 0.0, 0.0))
    satellites = receiver + np.array([[1e7, 0.0, 0.0], [0.0, 1e7, 0.0], [0.0, 0.0, 1e7], [1e7, -1e7, 0.0]])
    elevation, azimuth = elevation_azimuth(receiver, satellites)
    np.testing.assert_allclose(np.degrees(elevation), [90.0, 0.0, 0.0, 45.0], atol=1e-9)
    np.testing.assert_allclose(np.degrees(azimuth)[1:], [90.0, 0.0, 270.0], atol=1e-9)
