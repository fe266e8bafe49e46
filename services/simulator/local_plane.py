"""A line's plane on the Earth: x east, y north from the origin, z along the plumb line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.numerics.geodesy import (
    E2,
    WGS84_A_M,
    ecef_from_geodetic,
    enu_from_ecef_rotation,
    geodetic_from_ecef,
)

Floats = NDArray[np.float64]


class LocalPlane:
    """Tangent plane whose heights follow the Earth's curvature.

    A point z metres above the origin's level lies at z - (x^2 + y^2) / 2R over the tangent plane,
    R being the Gaussian radius: its ellipsoidal height is right to 3 mm within 3 km.
    """

    def __init__(self, lat_deg: float, lon_deg: float, height_m: float) -> None:
        """Touch the ellipsoid's parallel surface at a point (ellipsoidal height)."""
        lat_rad, lon_rad = np.deg2rad(lat_deg), np.deg2rad(lon_deg)
        self._origin_m = np.array(ecef_from_geodetic(lat_rad, lon_rad, height_m))
        self.enu_from_ecef = enu_from_ecef_rotation(float(lat_rad), float(lon_rad))
        """Rotation (3, 3) of Earth-fixed differences into the plane."""
        bend = 1 - E2 * np.sin(lat_rad) ** 2
        self._radius_m = WGS84_A_M * np.sqrt(1 - E2) / bend + height_m

    def ecef(self, xyz_m: Floats) -> Floats:
        """Earth-fixed positions (..., 3) of points of the plane (..., 3)."""
        lowered = np.array(xyz_m)
        lowered[..., 2] -= (lowered[..., 0] ** 2 + lowered[..., 1] ** 2) / (2 * self._radius_m)
        return np.asarray(self._origin_m + lowered @ self.enu_from_ecef)

    def xyz(self, position_ecef_m: Floats) -> Floats:
        """Points of the plane (..., 3) for Earth-fixed positions (..., 3)."""
        points = (np.asarray(position_ecef_m) - self._origin_m) @ self.enu_from_ecef.T
        points[..., 2] += (points[..., 0] ** 2 + points[..., 1] ** 2) / (2 * self._radius_m)
        return np.asarray(points)

    def ecef_velocity(self, xyz_m: Floats, velocity_mps: Floats) -> Floats:
        """Earth-fixed velocity (3,) of a point of the plane (3,) that moves in it (3,)."""
        bent = np.array(velocity_mps)
        bent[2] -= (xyz_m[0] * bent[0] + xyz_m[1] * bent[1]) / self._radius_m
        return np.asarray(bent @ self.enu_from_ecef)

    def geodetic_deg(self, xyz_m: Floats) -> tuple[Floats, Floats, Floats]:
        """Latitude, longitude [deg] and ellipsoidal height [m] of points of the plane (..., 3)."""
        position = self.ecef(xyz_m)
        lat_rad, lon_rad, height_m = geodetic_from_ecef(position[..., 0], position[..., 1], position[..., 2])
        return np.rad2deg(lat_rad), np.rad2deg(lon_rad), height_m
