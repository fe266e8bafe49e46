"""Where a base receiver stands, as people write it."""

from __future__ import annotations

import re
from typing import Final

from services.gnss_correction.atmosphere import HIGHEST_HEIGHT_M, LOWEST_HEIGHT_M

_PARTS: Final = 3
_EAST_DEG, _NORTH_DEG = 180.0, 90.0


def parse_position(text: str) -> tuple[float, float, float]:
    """Latitude, longitude [deg] and ellipsoidal height [m] from `LAT,LON,H` (commas or blanks). Raises ValueError.

    >>> parse_position("31.1824, 121.4019, 7")
    (31.1824, 121.4019, 7.0)
    """
    parts = re.split(r"[,\s]+", text.strip())
    try:
        figures = [float(part) for part in parts]
    except ValueError:
        figures = []
    if len(figures) != _PARTS:
        msg = f"{text!r} is not LAT,LON,H: latitude and longitude in degrees, ellipsoidal height in metres"
        raise ValueError(msg)
    lat_deg, lon_deg, h_m = figures
    on_earth = abs(lat_deg) <= _NORTH_DEG and abs(lon_deg) <= _EAST_DEG and LOWEST_HEIGHT_M <= h_m <= HIGHEST_HEIGHT_M
    if not on_earth:
        msg = f"{text!r} is no place on the ground (latitude within 90, longitude within 180 degrees)"
        raise ValueError(msg)
    return lat_deg, lon_deg, h_m
