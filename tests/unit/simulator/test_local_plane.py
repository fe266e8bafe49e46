from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.simulator.local_plane import LocalPlane

PLANE = LocalPlane(35.44, 139.83, 50.0)
metres = st.floats(-3000.0, 3000.0)


def test_the_origin_is_where_it_was_put() -> None:
    lat_deg, lon_deg, height_m = PLANE.geodetic_deg(np.zeros(3))
    # 1e-9 m over the Earth's radius is 1e-14 degrees; Bowring's formula holds to 1e-9 m.
    assert (lat_deg, lon_deg) == pytest.approx((35.44, 139.83), abs=1e-12)
    assert height_m == pytest.approx(50.0, abs=1e-8)


@given(x=metres, y=metres, z=st.floats(-10.0, 60.0))
def test_the_plane_follows_the_level(x: float, y: float, z: float) -> None:
    # The curvature radii of the ellipsoid differ by 0.7 %, the drop at 4.2 km is 1.4 m.
    assert PLANE.geodetic_deg(np.array([x, y, z]))[2] == pytest.approx(50.0 + z, abs=6e-3)


@given(x=metres, y=metres)
def test_lengths_hold(x: float, y: float) -> None:
    here, there = np.array([x, y, 4.0]), np.array([x + 3.0, y + 4.0, 4.0])
    # 5 m stretched by the squared slope of 4.2 km over the radius, 4e-7.
    assert np.linalg.norm(PLANE.ecef(there) - PLANE.ecef(here)) == pytest.approx(5.0, abs=3e-6)


@given(x=metres, y=metres)
def test_velocity_is_how_fast_the_place_changes(x: float, y: float) -> None:
    here, velocity = np.array([x, y, 4.0]), np.array([15.0, -8.0, 0.0])
    change = PLANE.ecef(here + velocity / 2) - PLANE.ecef(here - velocity / 2)
    # The drop is quadratic, so a central difference is exact but for rounding of 6e6 m.
    assert np.allclose(PLANE.ecef_velocity(here, velocity), change, atol=1e-8)
