"""Corrections of one instant as columns, and whether they may be believed."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from schemas.gnss import Corrections, SatelliteCorrection
from schemas.gnss_time import WEEK_S
from services.gnss_correction.atmosphere import L1_HZ, klobuchar_delay_m, saastamoinen_delay_m
from services.gnss_correction.ephemeris_table import CODES, EphemerisTable
from services.gnss_correction.orbit import BEIDOU_B1I_HZ, satellite_states
from services.gnss_correction.solver_arrays import Float64s, Ints
from services.gnss_correction.station_consistency import LARGEST_RESIDUAL, displaced, fit_station
from services.gnss_correction.station_sight import Station, station_at
from services.gnss_receiver.observations import SYSTEMS, satellite_code
from services.numerics.geodesy import elevation_azimuth

LARGEST_M: Final = 300.0
"""Of a correction: satellite clocks off by a microsecond; beyond, something else is wrong."""
FASTEST_MPS: Final = 5.0
LARGEST_SIGMA_M: Final = 50.0
TRAVEL_S: Final = 0.075
"""Signals are under way for about so long; directions need it no better."""
_BEIDOU: Final = SYSTEMS.index("C")


@dataclass(slots=True)
class CorrectionSet:
    """Corrections of one station at one instant; columns have shape (n,)."""

    gps_s: float
    """Counted from the GPS epoch."""
    station_name: str
    station: Station
    index: Ints
    """Shape (CODES,): row of each satellite, -1 where it has none."""
    code: Ints
    signal: tuple[str, ...]
    issue: Ints
    toe_gps_s: Float64s
    correction_m: Float64s
    rate_mps: Float64s
    sigma_m: Float64s
    others: dict[tuple[int, str], float]
    """By satellite code and further signal: what is to be added to the correction for it [m]."""
    refused: dict[int, str]
    """Satellites that the station refused, or that are not believed, and why."""
    checked: bool = field(default=False)
    """Whether the consistency has been looked at; `fault` and `refused` hold what was found."""
    fault: str = ""


def _fault_of(one: SatelliteCorrection) -> str:
    """Why a correction cannot be meant; empty when it can."""
    figures = (one.correction_m, one.rate_mps, one.sigma_m, one.toe_s)
    if not all(math.isfinite(figure) for figure in figures):
        return "the correction is no number"
    if abs(one.correction_m) > LARGEST_M or abs(one.rate_mps) > FASTEST_MPS or one.sigma_m > LARGEST_SIGMA_M:
        return f"absurd correction of {one.correction_m:.0f} m, {one.rate_mps:.1f} m/s"
    return ""


def _kept_and_refused(message: Corrections) -> tuple[dict[int, SatelliteCorrection], dict[int, str]]:
    """Corrections by satellite, and why there is none, by satellite."""
    refused = {satellite_code(one.satellite): f"the station says: {one.reason}" for one in message.refused}
    kept: dict[int, SatelliteCorrection] = {}
    for one in message.satellites:
        code = satellite_code(one.satellite)
        fault = "two corrections at once" if code in kept else _fault_of(one)
        if fault:
            refused[code] = fault
            kept.pop(code, None)
        else:
            kept[code] = one
    return kept, refused


def correction_set(message: Corrections) -> CorrectionSet:
    """Columns of a message. Absurd corrections are refused; ValueError where place or time make no sense."""
    place = (message.lat_deg, message.lon_deg, message.h_m)
    if not all(math.isfinite(figure) for figure in (*place, message.tow_s)):
        msg = "the station's place or time is no number"
        raise ValueError(msg)
    if not (abs(message.lat_deg) <= 90.0 and abs(message.h_m) < 10_000.0):  # noqa: PLR2004 - degrees of latitude, and no mountain is higher
        msg = f"the station is at no place on the ground: {message.lat_deg:g}°, height {message.h_m:g} m"
        raise ValueError(msg)
    kept, refused = _kept_and_refused(message)
    given = list(kept.values())
    codes = np.array(list(kept), np.int64)
    index = np.full(CODES, -1, np.int64)
    index[codes] = np.arange(codes.size)
    return CorrectionSet(
        gps_s=message.gps_week * float(WEEK_S) + message.tow_s,
        station_name=message.station,
        station=station_at(*place),
        index=index,
        code=codes,
        signal=tuple(one.signal for one in given),
        issue=np.array([one.issue for one in given], np.int64),
        toe_gps_s=np.array([one.toe_week * float(WEEK_S) + one.toe_s for one in given]),
        correction_m=np.array([one.correction_m for one in given]),
        rate_mps=np.array([one.rate_mps for one in given]),
        sigma_m=np.array([one.sigma_m for one in given]),
        others={
            (code, other.signal): other.difference_m
            for code, one in kept.items()
            for other in one.others
            if math.isfinite(other.difference_m)
        },
        refused=refused,
    )


def ephemeris_rows(corrections: CorrectionSet, table: EphemerisTable) -> Ints:
    """Row of the table for which each correction was made; negative where the table does not have it."""
    found = np.full(corrections.code.size, -1, np.int64)
    toe_s = corrections.toe_gps_s - table.gps_week * float(WEEK_S)
    for i, code in enumerate(corrections.code.tolist()):
        first, last = int(table.first[code]), int(table.first[code + 1])
        rows = table.rows[first:last]
        same = np.flatnonzero((rows["toe_s"] == toe_s[i]) & (rows["issue"] == corrections.issue[i]))
        if same.size:
            found[i] = first + int(same[-1])
    return found


def check(corrections: CorrectionSet, table: EphemerisTable, rules: np.void) -> None:
    """Hold a set's corrections against each other and the station's place; fills `fault` and `refused`.

    Whoever has not the ephemerides of enough of them cannot tell, and does not believe.
    """
    corrections.checked = True
    row = ephemeris_rows(corrections, table)
    known = row >= 0
    if not known.any():
        corrections.fault = "no correction is for an ephemeris that is known here"
        return
    t_s = corrections.gps_s - table.gps_week * float(WEEK_S)
    states = satellite_states(table, row[known], np.full(int(known.sum()), t_s - TRAVEL_S))
    station, code = corrections.station, corrections.code[known]
    elevation_rad, azimuth_rad = elevation_azimuth(station.place_m, states.position_m)
    lat_rad, lon_rad, h_m = station.level
    carrier_hz = np.where(code // 100 == _BEIDOU, BEIDOU_B1I_HZ, L1_HZ)
    air_m = saastamoinen_delay_m(lat_rad, h_m, elevation_rad)
    air_m = air_m + klobuchar_delay_m(
        rules["alpha"], rules["beta"], lat_rad, lon_rad, elevation_rad, azimuth_rad, t_s, carrier_hz
    )
    lines = states.position_m - station.place_m
    lines = (lines / np.linalg.norm(lines, axis=1)[:, None]) @ station.enu_from_ecef.T
    fit = fit_station(lines, code // 100, elevation_rad, -corrections.correction_m[known] - air_m)
    corrections.fault = displaced(fit)
    if not np.isfinite(fit.east_north_up_m).all():
        corrections.fault = "too few corrections to check the station by them"
    for i in np.flatnonzero(np.abs(fit.residual_m) > LARGEST_RESIDUAL * fit.sigma_m).tolist():
        corrections.refused[int(code[i])] = f"its correction contradicts the others by {abs(fit.residual_m[i]):.0f} m"
