"""Prepared rows as a place that is known sees them: directions, ranges, and the models of the air there."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from services.gnss_correction.line_of_sight import delay_m, direct, look
from services.gnss_correction.solver_arrays import Float64s, Records
from services.numerics.geodesy import ecef_from_geodetic, enu_from_ecef_rotation
from services.numerics.kernel import kernel


class Station(NamedTuple):
    """A place that is known."""

    place_m: Float64s
    """Shape (3,), Earth-fixed."""
    level: tuple[float, float, float]
    """Latitude, longitude [rad], ellipsoidal height [m]."""
    enu_from_ecef: Float64s
    """Shape (3, 3)."""


def station_at(lat_deg: float, lon_deg: float, h_m: float) -> Station:
    """A station by its WGS 84 coordinates."""
    lat_rad, lon_rad = float(np.radians(lat_deg)), float(np.radians(lon_deg))
    place_m = np.array(ecef_from_geodetic(lat_rad, lon_rad, h_m))
    return Station(place_m, (lat_rad, lon_rad, h_m), enu_from_ecef_rotation(lat_rad, lon_rad))


@kernel
def _see(
    rows: Records,
    tow_s: float,
    rules: Any,  # noqa: ANN401 - numba record
    place: Float64s,
    level: tuple[float, float, float],
    air_m: Float64s,
) -> None:
    for i in range(rows.size):
        row = rows[i]
        look(row, place)
        direct(row, level)
        air_m[i] = delay_m(row, level, tow_s, rules)


def see_from(station: Station, rows: Records, tow_s: float, rules: np.void) -> Float64s:
    """Fill directions and `modelled_m` (without air and receiver clock) of `rows` (dtype ROW) in place.

    Gives what the models say of the air on each path [m], NaN where a row has no satellite. `tow_s`
    is GPS time from the start of any week.
    """
    air_m = np.empty(rows.size)
    _see(rows, tow_s, rules, station.place_m, station.level, air_m)
    return air_m


def lines_enu(station: Station, rows: Records) -> Float64s:
    """Unit vectors (n, 3) towards the satellites of rows that were seen from the station: east, north, up."""
    lines = np.stack([rows["line_x"], rows["line_y"], rows["line_z"]], axis=-1)
    return np.asarray(lines @ station.enu_from_ecef.T)
