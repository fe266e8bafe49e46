"""WGS 84: geodetic against Earth-centred Earth-fixed coordinates, local level, directions.

Angles in radians, lengths in metres. The formulas take floats or arrays alike (and are
compiled as they stand by the kernels).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

WGS84_A_M: Final = 6_378_137.0
"""Semi-major axis (NGA.STND.0036, table 3.1)."""
WGS84_F: Final = 1.0 / 298.257223563
"""Flattening (NGA.STND.0036, table 3.1)."""
WGS84_B_M: Final = WGS84_A_M * (1.0 - WGS84_F)
E2: Final = WGS84_F * (2.0 - WGS84_F)
"""First eccentricity squared."""
EP2: Final = E2 / (1.0 - E2)
"""Second eccentricity squared."""

Vectors = NDArray[np.float64]
"""Shape (..., 3)."""


def ecef_from_geodetic(lat_rad: Any, lon_rad: Any, h_m: Any) -> tuple[Any, Any, Any]:  # noqa: ANN401 - float or array alike
    """Earth-fixed x, y, z [m] of latitude, longitude [rad] and ellipsoidal height [m].

    >>> ecef_from_geodetic(0.0, 0.0, 0.0)[0] == WGS84_A_M
    np.True_
    """
    sin_lat = np.sin(lat_rad)
    normal_m = WGS84_A_M / np.sqrt(1.0 - E2 * sin_lat * sin_lat)
    ring_m = (normal_m + h_m) * np.cos(lat_rad)
    return ring_m * np.cos(lon_rad), ring_m * np.sin(lon_rad), (normal_m * (1.0 - E2) + h_m) * sin_lat


def geodetic_from_ecef(x_m: Any, y_m: Any, z_m: Any) -> tuple[Any, Any, Any]:  # noqa: ANN401 - float or array alike
    """Latitude, longitude [rad] and ellipsoidal height [m] of Earth-fixed x, y, z [m].

    Bowring 1976 through the parametric latitude, three rounds: below 1e-9 m from 100 km
    under the surface to beyond the satellites. Defined everywhere; at the Earth's centre
    the latitude is 0 and the height is minus the semi-major axis.
    """
    ring_m = np.sqrt(x_m * x_m + y_m * y_m)
    sin_beta = WGS84_A_M * z_m
    cos_beta = WGS84_B_M * ring_m
    lat_rad = np.arctan2(sin_beta, cos_beta)
    for _ in range(3):
        size = np.sqrt(sin_beta * sin_beta + cos_beta * cos_beta) + 1e-300
        sin_beta, cos_beta = sin_beta / size, cos_beta / size
        over_m = z_m + EP2 * WGS84_B_M * sin_beta**3
        along_m = ring_m - E2 * WGS84_A_M * cos_beta**3
        lat_rad = np.arctan2(over_m, along_m)
        sin_beta, cos_beta = WGS84_B_M * over_m, WGS84_A_M * along_m
    sin_lat, cos_lat = np.sin(lat_rad), np.cos(lat_rad)
    h_m = ring_m * cos_lat + z_m * sin_lat - WGS84_A_M * np.sqrt(1.0 - E2 * sin_lat * sin_lat)
    return lat_rad, np.arctan2(y_m, x_m), h_m


def enu_from_ecef_rotation(lat_rad: float, lon_rad: float) -> NDArray[np.float64]:
    """Rotation (3, 3) that turns Earth-fixed differences into east, north, up.

    Its transpose turns them back.
    """
    sin_lat, cos_lat = np.sin(lat_rad), np.cos(lat_rad)
    sin_lon, cos_lon = np.sin(lon_rad), np.cos(lon_rad)
    return np.array(
        [
            [-sin_lon, cos_lon, 0.0],
            [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
            [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
        ]
    )


def enu_about(
    reference_deg: tuple[float, float, float], lat_deg: ArrayLike, lon_deg: ArrayLike, h_m: ArrayLike
) -> Vectors:
    """East, north, up [m], shape (n, 3), of points about a reference (latitude, longitude [deg], height [m])."""
    lat0_rad, lon0_rad = np.radians(reference_deg[0]), np.radians(reference_deg[1])
    origin = np.array(ecef_from_geodetic(lat0_rad, lon0_rad, reference_deg[2]))
    points = np.stack(ecef_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), np.asarray(h_m, float)), axis=-1)
    return np.asarray((points - origin) @ enu_from_ecef_rotation(lat0_rad, lon0_rad).T)


def elevation_azimuth(receiver_m: Vectors, satellite_m: Vectors) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Elevation and azimuth [rad] of satellites (n, 3) seen from one receiver (3,), both Earth-fixed.

    Azimuth from north over east, in [0, 2π).
    """
    lat_rad, lon_rad, _ = geodetic_from_ecef(*receiver_m)
    difference = (np.atleast_2d(satellite_m) - receiver_m) @ enu_from_ecef_rotation(lat_rad, lon_rad).T
    east_m, north_m, up_m = difference.T
    return np.arctan2(up_m, np.hypot(east_m, north_m)), np.arctan2(east_m, north_m) % (2.0 * np.pi)
