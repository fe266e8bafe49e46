"""The way of an antenna that rides above the rail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from services.line.axis import Axis
from services.numerics.geodesy import geodetic_from_ecef


def raised(axis: Axis, above_m: float) -> Axis:
    """Axis with its points lifted by `above_m` along the normal of the ellipsoid; lengths stay those of the rail."""
    if above_m == 0.0:
        return axis
    lat_rad, lon_rad, _ = geodetic_from_ecef(*axis.ecef_m.T)
    up = np.stack([np.cos(lat_rad) * np.cos(lon_rad), np.cos(lat_rad) * np.sin(lon_rad), np.sin(lat_rad)], axis=-1)
    return replace(axis, ecef_m=np.ascontiguousarray(axis.ecef_m + above_m * up))
