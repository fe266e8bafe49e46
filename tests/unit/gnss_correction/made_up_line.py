"""A made-up line and what a receiver on it measures: satellites that stand still, errors as wanted."""

from __future__ import annotations

import numpy as np

from services.gnss_correction.atmosphere import L1_HZ
from services.gnss_correction.line_of_sight import delay_m, direct, look
from services.gnss_correction.position_fit import geodetic
from services.gnss_correction.solver_arrays import ROW, RULES
from services.line.axis import Axis, axis_of
from services.line.chainage import Chainage
from services.line.line_file import LineGeometry
from services.numerics.geodesy import enu_from_ecef_rotation

LAT_DEG, LON_DEG, H_M = 52.5, 13.4, 80.0
METRES_PER_LAT = 111_272.0
METRES_PER_LON = 67_900.0
TOW_S = 200_000.0
AZIMUTHS_DEG = (10, 50, 95, 130, 170, 200, 245, 290, 320, 350)
ELEVATIONS_DEG = (25, 60, 35, 75, 20, 45, 30, 55, 40, 70)
SYSTEMS = (0, 0, 0, 0, 0, 0, 2, 2, 2, 2)
RULES_HERE = np.zeros(1, RULES)
RULES_HERE["elevation_mask_rad"] = np.radians(5.0)


def axis_through(east_m: np.ndarray, north_m: np.ndarray) -> Axis:
    """Axis through points of a plane."""
    return axis_of(LAT_DEG + north_m / METRES_PER_LAT, LON_DEG + east_m / METRES_PER_LON, np.full(len(east_m), H_M))


def bend() -> Axis:
    """3 km: 1.2 km to the east, a curve of 400 m radius to the left, and on to the north."""
    straight = np.arange(0.0, 1200.0, 10.0)
    turn = np.radians(np.arange(0.0, 90.5, 1.0))
    east = np.concatenate([straight, 1200.0 + 400.0 * np.sin(turn), np.full(120, 1600.0)])
    north = np.concatenate([0.0 * straight, 400.0 * (1 - np.cos(turn)), 400.0 + np.arange(10.0, 1210.0, 10.0)])
    return axis_through(east, north)


def there_and_back() -> Axis:
    """300 m to the east, a loop, and the same 300 m back, 4 m beside, then on to the west for 600 m."""
    straight = np.arange(0.0, 300.0, 10.0)
    turn = np.radians(np.arange(-90.0, 135.0, 3.0))
    east = np.concatenate([straight, 300.0 + 120.0 * np.cos(turn), np.arange(200.0, -600.0, -10.0)])
    north = np.concatenate([0.0 * straight, 120.0 + 120.0 * np.sin(turn), np.full(80, 4.0)])
    return axis_through(east, north)


def geometry(axis: Axis) -> LineGeometry:
    """A line whose kilometrage begins with 10 km."""
    ends = np.array([0.0, axis.length_m])
    return LineGeometry("made-up", "Made up", axis, Chainage(ends, ends + 10_000.0))


def rows_at(
    place_m: np.ndarray,
    velocity_mps: np.ndarray,
    *,
    clock_m: float = 0.0,
    drift_mps: float = 0.0,
    extra_m: np.ndarray | float = 0.0,
    tow_s: float = TOW_S,
    count: int = 10,
) -> np.ndarray:
    """Rows (dtype ROW) measured at an Earth-fixed place and velocity, pseudoranges longer by `extra_m`."""
    rows = np.zeros(len(AZIMUTHS_DEG), ROW)
    level = geodetic(*place_m)
    home = (np.radians(LAT_DEG), np.radians(LON_DEG))
    for k, row in enumerate(rows):
        azimuth, elevation = np.radians(AZIMUTHS_DEG[k]), np.radians(ELEVATIONS_DEG[k])
        enu = np.array([np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)])
        sight = enu_from_ecef_rotation(*home).T @ enu
        row["x_m"], row["y_m"], row["z_m"] = 3.8e6 * np.array([0.6, 0.14, 0.79]) + 2.2e7 * sight
        row["system"], row["satellite"] = SYSTEMS[k], 100 * SYSTEMS[k] + k + 1
        row["strength_dbhz"], row["cn0_dbhz"], row["carrier_hz"] = 45.0, 45.0, L1_HZ
    for row in rows:
        look(row, place_m)
        direct(row, level)
        line = np.array([row["line_x"], row["line_y"], row["line_z"]])
        row["pseudorange_m"] = row["modelled_m"] + delay_m(row, level, tow_s, RULES_HERE[0]) + clock_m
        row["range_rate_mps"] = -line @ velocity_mps + drift_mps
    rows["pseudorange_m"] += extra_m
    rows["pseudorange_m"][rows["system"] == 2] += 12.0  # the other constellation's time
    return rows[:count]
