"""Where a satellite stands in the sky of a receiver, and what its pseudorange should be."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from services.gnss_correction.atmosphere import LIGHT_MPS, klobuchar_delay_m, saastamoinen_delay_m
from services.numerics.kernel import kernel

EARTH_RATE_RADPS: Final = 7.2921151467e-5
"""Rotation of WGS 84 (IS-GPS-200, table 20-IV); the other systems' differ by 2e-9 of it."""

_klobuchar = kernel(klobuchar_delay_m)
_saastamoinen = kernel(saastamoinen_delay_m)


@kernel
def look(row: Any, place: Any) -> None:  # noqa: ANN401 - numba record and array
    """Line of sight and geometric part of a pseudorange, seen from `place` (3,), into the row."""
    dx, dy, dz = row.x_m - place[0], row.y_m - place[1], row.z_m - place[2]
    distance_m = np.sqrt(dx * dx + dy * dy + dz * dz)
    row.line_x, row.line_y, row.line_z = dx / distance_m, dy / distance_m, dz / distance_m
    turn_m = EARTH_RATE_RADPS / LIGHT_MPS * (row.x_m * place[1] - row.y_m * place[0])
    row.modelled_m = distance_m + turn_m - row.clock_m


@kernel
def direct(row: Any, level: tuple[float, float, float]) -> None:  # noqa: ANN401 - numba record
    """Elevation and azimuth of a row at `level` (latitude, longitude, height)."""
    sin_lat, cos_lat = np.sin(level[0]), np.cos(level[0])
    sin_lon, cos_lon = np.sin(level[1]), np.cos(level[1])
    outwards = cos_lon * row.line_x + sin_lon * row.line_y
    north, up = cos_lat * row.line_z - sin_lat * outwards, cos_lat * outwards + sin_lat * row.line_z
    east = cos_lon * row.line_y - sin_lon * row.line_x
    row.elevation_rad = np.arctan2(up, np.sqrt(north * north + east * east))
    row.azimuth_rad = np.arctan2(east, north) % (2.0 * np.pi)


@kernel
def delay_m(row: Any, level: tuple[float, float, float], tow_s: float, rules: Any) -> Any:  # noqa: ANN401 - numba record
    """Ionosphere and troposphere on the way to a row's satellite [m]."""
    ionosphere_m = _klobuchar(
        rules.alpha, rules.beta, level[0], level[1], row.elevation_rad, row.azimuth_rad, tow_s, row.carrier_hz
    )
    return ionosphere_m + _saastamoinen(level[0], level[2], row.elevation_rad)
