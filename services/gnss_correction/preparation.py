"""What stands between raw observations and the solver: one signal per satellite, its satellite, or why not."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.gnss_time import WEEK_S
from services.gnss_correction.atmosphere import L1_HZ, LIGHT_MPS
from services.gnss_correction.ephemeris_table import NO_EPHEMERIS, STALE, UNHEALTHY, EphemerisTable, select
from services.gnss_correction.orbit import (
    BEIDOU_B1I_HZ,
    GLONASS_L1_HZ,
    GLONASS_L1_STEP_HZ,
    transmission_states,
)
from services.gnss_correction.rejection import Rejection
from services.gnss_correction.solver_arrays import ROW, Float64s, Records
from services.gnss_receiver.observations import SYSTEMS, Observations

PREFERRED_SIGNALS: Final = {
    "G": ("1C", "1W", "1P", "1Y"),
    "R": ("1C", "1P"),
    "E": ("1C", "1X", "1B"),
    "C": ("2I", "2X", "1I"),
    "J": ("1C", "1E"),
}
"""Signals that can be used, best first: those on which the broadcast clock and group delay hold."""
SHORTEST_PSEUDORANGE_M: Final = 1.0e7
LONGEST_PSEUDORANGE_M: Final = 1.0e8
"""Between them lie all navigation satellites, with 100 ms of receiver clock to spare."""
FASTEST_RANGE_RATE_MPS: Final = 10_000.0
"""A satellite's 1 km/s and a receiver clock that drifts by 30 ppm."""
LOWEST_ORBIT_M: Final = 2.0e7
HIGHEST_ORBIT_M: Final = 6.0e7
STRONGEST_DBHZ: Final = 70.0
"""No civil signal is received as strong; 0 stands for unknown in RINEX."""
_UNUSABLE: Final = 50
_NO_PSEUDORANGE: Final = 100


@dataclass(frozen=True, slots=True)
class Prepared:
    """One row per epoch and satellite of the selected systems, by epoch, then by satellite code."""

    t_s: Float64s
    """Shape (epochs,): by the receiver's clock, from the start of the table's week."""
    first_row: NDArray[np.int64]
    """Shape (epochs + 1,)."""
    satellite: NDArray[np.int64]
    """Satellite codes."""
    signal: NDArray[np.int64]
    rows: Records
    """Dtype ROW, with what is given filled in."""
    ephemeris: NDArray[np.int64]
    """Row of the ephemeris table, or why none (negative)."""


@lru_cache(maxsize=64)
def _priorities(signals: tuple[str, ...], systems: str) -> NDArray[np.int64]:
    """Priority of each system (row) and signal (column); -1 for systems that are off, _UNUSABLE for other signals."""
    table = np.full((len(SYSTEMS), max(len(signals), 1)), -1, np.int64)
    for system in systems:
        preferred = PREFERRED_SIGNALS[system]
        table[SYSTEMS.index(system)] = [preferred.index(s) if s in preferred else _UNUSABLE for s in signals] or [-1]
    table.flags.writeable = False
    return table


def _choose(observations: Observations, systems: str) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Observation row of each epoch and satellite, the first such row of each epoch, and its priority."""
    epochs = len(observations)
    epoch = np.repeat(np.arange(epochs), np.diff(observations.first_row))
    code = observations.satellite.astype(np.int64)
    priority = _priorities(observations.signals, systems)[code // 100, observations.signal]
    priority = priority + np.where(np.isnan(observations.pseudorange_m) & (priority >= 0), _NO_PSEUDORANGE, 0)
    wanted = np.flatnonzero(priority >= 0)
    group = epoch[wanted] * 1000 + code[wanted]
    order = np.lexsort((priority[wanted], group))
    group = group[order]
    best = np.ones(group.size, bool)
    best[1:] = group[1:] != group[:-1]
    first_row = np.searchsorted(group[best], np.arange(epochs + 1) * 1000).astype(np.int64)
    chosen = wanted[order][best]
    return chosen, first_row, priority[chosen]


def _screen(pseudorange_m: Float64s, priority: NDArray[np.int64], ephemeris: NDArray[np.int64]) -> NDArray[np.int64]:
    """First thing that is wrong with each row, as far as it can be told without its orbit."""
    in_range = (pseudorange_m > SHORTEST_PSEUDORANGE_M) & (pseudorange_m < LONGEST_PSEUDORANGE_M)
    return np.select(
        [
            np.isnan(pseudorange_m),
            priority >= _UNUSABLE,
            ~in_range,
            ephemeris == NO_EPHEMERIS,
            ephemeris == STALE,
            ephemeris == UNHEALTHY,
        ],
        [
            Rejection.NO_PSEUDORANGE,
            Rejection.NO_SIGNAL,
            Rejection.ABSURD_PSEUDORANGE,
            Rejection.NO_EPHEMERIS,
            Rejection.STALE_EPHEMERIS,
            Rejection.UNHEALTHY,
        ],
        Rejection.USABLE,
    ).astype(np.int64)


def _carriers_hz(code: NDArray[np.int64], ephemeris: NDArray[np.int64], table: EphemerisTable) -> Float64s:
    """Carrier of each row; a GLONASS satellite without an ephemeris is taken for channel 0."""
    carrier_hz = np.full(code.size, L1_HZ)
    system = code // 100
    carrier_hz[system == SYSTEMS.index("C")] = BEIDOU_B1I_HZ
    glonass = system == SYSTEMS.index("R")
    known = glonass & (ephemeris >= 0)
    carrier_hz[glonass] = GLONASS_L1_HZ
    carrier_hz[known] += GLONASS_L1_STEP_HZ * table.rows["frequency_channel"][ephemeris[known]]
    return carrier_hz


def prepare(observations: Observations, table: EphemerisTable, systems: str) -> Prepared:
    """Rows of the selected `systems` (letters of PREFERRED_SIGNALS) with satellites and first rejections.

    Of a satellite's signals the first preferred one with a pseudorange counts, of a satellite
    that stands twice in an epoch the first. Impossible Dopplers and C/N0 count as missing.
    """
    t_s = (observations.gps_week - table.gps_week) * float(WEEK_S) + observations.tow_s
    chosen, first_row, priority = _choose(observations, systems)
    code = observations.satellite[chosen].astype(np.int64)
    pseudorange_m = np.array(observations.pseudorange_m[chosen])
    row_t_s = np.repeat(t_s, np.diff(first_row))
    ephemeris = select(table, code, row_t_s)
    rejection = _screen(pseudorange_m, priority, ephemeris)
    states = transmission_states(table, np.where(rejection == Rejection.USABLE, ephemeris, -1), row_t_s, pseudorange_m)
    radius_m = np.sqrt((states.position_m**2).sum(axis=1))
    no_orbit = ~((radius_m > LOWEST_ORBIT_M) & (radius_m < HIGHEST_ORBIT_M) & np.isfinite(states.clock_bias_s))
    rejection[no_orbit & (rejection == Rejection.USABLE)] = Rejection.NO_ORBIT
    carrier_hz = _carriers_hz(code, ephemeris, table)
    range_rate_mps = -LIGHT_MPS / carrier_hz * observations.doppler_hz[chosen]
    range_rate_mps[~(np.abs(range_rate_mps) < FASTEST_RANGE_RATE_MPS)] = np.nan
    cn0_dbhz = observations.cn0_dbhz[chosen]
    rows = np.zeros(code.size, ROW)
    rows["system"], rows["rejection"] = code // 100, rejection
    rows["x_m"], rows["y_m"], rows["z_m"] = states.position_m.T
    rows["vx_mps"], rows["vy_mps"], rows["vz_mps"] = states.velocity_mps.T
    rows["clock_m"], rows["drift_mps"] = states.clock_bias_s * LIGHT_MPS, states.clock_drift * LIGHT_MPS
    rows["pseudorange_m"], rows["range_rate_mps"], rows["carrier_hz"] = pseudorange_m, range_rate_mps, carrier_hz
    rows["cn0_dbhz"] = np.where((cn0_dbhz > 0.0) & (cn0_dbhz < STRONGEST_DBHZ), cn0_dbhz, np.nan)
    return Prepared(
        t_s=t_s,
        first_row=first_row,
        satellite=code,
        signal=observations.signal[chosen].astype(np.int64),
        rows=rows,
        ephemeris=ephemeris,
    )
