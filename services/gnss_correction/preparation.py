"""What stands between raw observations and the solver: one signal per satellite, its satellite, or why not."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np

from schemas.gnss_time import WEEK_S
from services.gnss_correction.atmosphere import L1_HZ, LIGHT_MPS
from services.gnss_correction.ephemeris_table import (
    CODES,
    NO_EPHEMERIS,
    STALE,
    UNHEALTHY,
    EphemerisTable,
    select_row,
)
from services.gnss_correction.orbit import (
    BEIDOU_B1I_HZ,
    GLONASS_L1_HZ,
    GLONASS_L1_STEP_HZ,
    state_when_sent,
)
from services.gnss_correction.rejection import Rejection
from services.gnss_correction.solver_arrays import ROW, Bools, Float64s, Ints, Records
from services.gnss_receiver.observations import SYSTEMS, Observations
from services.numerics.kernel import kernel

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
LONGEST_SILENCE: Final = 5.0
"""Averaging times after which nothing is left of an old C/N0."""
_UNUSABLE: Final = 50
_NO_PSEUDORANGE: Final = 100
_BEIDOU, _GLONASS = SYSTEMS.index("C"), SYSTEMS.index("R")
_USABLE, _MISSING, _NO_SIGNAL = int(Rejection.USABLE), int(Rejection.NO_PSEUDORANGE), int(Rejection.NO_SIGNAL)
_ABSURD, _NONE, _STALE = int(Rejection.ABSURD_PSEUDORANGE), int(Rejection.NO_EPHEMERIS), int(Rejection.STALE_EPHEMERIS)
_UNHEALTHY, _NO_ORBIT, _REFUSED = int(Rejection.UNHEALTHY), int(Rejection.NO_ORBIT), int(Rejection.EPOCH_REFUSED)


class Columns(NamedTuple):
    """Observations as the kernel reads them (its own copies: one kind of array, one compilation)."""

    first_row: Ints
    satellite: Ints
    signal: Ints
    pseudorange_m: Float64s
    doppler_hz: Float64s
    cn0_dbhz: Float64s
    carrier_phase_cycles: Float64s
    lock_lost: Float64s


@dataclass(frozen=True, slots=True)
class Prepared:
    """One row per epoch and satellite of the selected systems, by epoch, then by satellite code."""

    t_s: Float64s
    """Shape (epochs,): by the receiver's clock, from the start of the table's week."""
    gps_s: Float64s
    """Shape (epochs,): the same from the beginning of GPS time, for what outlives a table; good to 0.3 microseconds."""
    first_row: Ints
    """Shape (epochs + 1,)."""
    rows: Records
    """Dtype ROW, with what is given filled in."""


@lru_cache(maxsize=64)
def _ranks(signals: tuple[str, ...], systems: str) -> Ints:
    """Rank of each system (row) and signal (column): 0 is best, -1 a system that is off, _UNUSABLE another signal."""
    table = np.full((len(SYSTEMS), max(len(signals), 1)), -1, np.int64)
    for system in systems:
        preferred = PREFERRED_SIGNALS[system]
        table[SYSTEMS.index(system)] = [preferred.index(s) if s in preferred else _UNUSABLE for s in signals] or [-1]
    return table


@kernel
def _choose(
    first: int, last: int, satellite: Ints, signal: Ints, pseudorange_m: Float64s, ranks: Ints, rows: Records
) -> int:
    """Sort an epoch's observations by satellite, of each satellite the best signal, into `rows`; gives how many."""
    count = 0
    for source in range(first, last):
        code = satellite[source]
        rank = ranks[code // 100, signal[source]]
        if rank < 0:
            continue
        if np.isnan(pseudorange_m[source]):
            rank += _NO_PSEUDORANGE
        k = count
        while k > 0 and rows[k - 1].satellite > code:
            k -= 1
        if k > 0 and rows[k - 1].satellite == code:
            if rank < rows[k - 1].rank:
                rows[k - 1].source, rows[k - 1].rank = source, rank
            continue
        for m in range(count, k, -1):
            rows[m].satellite, rows[m].source, rows[m].rank = (
                rows[m - 1].satellite,
                rows[m - 1].source,
                rows[m - 1].rank,
            )
        rows[k].satellite, rows[k].source, rows[k].rank = code, source, rank
        count += 1
    return count


@kernel
def _screen(row: Any) -> int:  # noqa: ANN401 - numba record
    """First thing that is wrong with a row, as far as it can be told without its orbit."""
    if np.isnan(row.pseudorange_m):
        return _MISSING
    if row.rank >= _UNUSABLE:
        return _NO_SIGNAL
    if not SHORTEST_PSEUDORANGE_M < row.pseudorange_m < LONGEST_PSEUDORANGE_M:
        return _ABSURD
    if row.ephemeris == NO_EPHEMERIS:
        return _NONE
    if row.ephemeris == STALE:
        return _STALE
    return _UNHEALTHY if row.ephemeris == UNHEALTHY else _USABLE


@kernel
def _carrier_hz(row: Any, ephemerides: Records) -> float:  # noqa: ANN401 - numba record
    """Carrier of a row; a GLONASS satellite without an ephemeris is taken for channel 0."""
    if row.system == _BEIDOU:
        return BEIDOU_B1I_HZ
    if row.system != _GLONASS:
        return L1_HZ
    if row.ephemeris < 0:
        return GLONASS_L1_HZ
    return GLONASS_L1_HZ + GLONASS_L1_STEP_HZ * float(ephemerides[row.ephemeris].frequency_channel)


@kernel
def _place_satellite(row: Any, t_s: float, ephemerides: Records, position: Float64s, velocity: Float64s) -> None:  # noqa: ANN401 - numba record
    """State of a row's satellite when its signal left; `position`, `velocity` (3,) are scratch."""
    for p in range(3):
        position[p], velocity[p] = np.nan, np.nan
    row.clock_m, row.drift_mps = np.nan, np.nan
    if row.rejection == _USABLE:
        bias_s, drift = state_when_sent(ephemerides[row.ephemeris], t_s, row.pseudorange_m, position, velocity)
        row.clock_m, row.drift_mps = bias_s * LIGHT_MPS, drift * LIGHT_MPS
        radius_m = np.sqrt(position[0] ** 2 + position[1] ** 2 + position[2] ** 2)
        if not (LOWEST_ORBIT_M < radius_m < HIGHEST_ORBIT_M and np.isfinite(row.clock_m)):
            row.rejection = _NO_ORBIT
    row.x_m, row.y_m, row.z_m = position[0], position[1], position[2]
    row.vx_mps, row.vy_mps, row.vz_mps = velocity[0], velocity[1], velocity[2]


class SignalStrengths:
    """C/N0 of every satellite's signal, averaged exponentially over the past."""

    def __init__(self, averaging_s: float) -> None:
        """Know nothing yet; 0 takes each value as it is."""
        self.averaging_s = averaging_s
        self.known = np.full((CODES, 3), np.nan)
        """Shape (CODES, 3): time of the latest value, its signal, the average."""


@kernel
def _average_strength(row: Any, t_s: float, averaging_s: float, known: Float64s) -> float:  # noqa: ANN401 - numba record
    """Averaged C/N0 of a row [dB-Hz]; begins anew with a new signal and after a gap."""
    age_s = t_s - known[0]
    follows = averaging_s > 0.0 and 0.0 < age_s < LONGEST_SILENCE * averaging_s and known[1] == row.signal
    average = row.cn0_dbhz
    if follows and np.isfinite(known[2]) and np.isfinite(average):
        average = known[2] + (1.0 - np.exp(-age_s / averaging_s)) * (average - known[2])
    known[0], known[1], known[2] = t_s, row.signal, average
    return float(average)


@kernel
def _prepare(
    columns: Columns,
    t_s: Float64s,
    refused: Bools,
    ranks: Ints,
    ephemerides: Records,
    first_ephemeris: Ints,
    averaging_s: float,
    known: Float64s,
    rows: Records,
) -> Ints:
    """Fill `rows` from the front; gives the first row of each epoch and the number of rows."""
    first_row = np.zeros(t_s.size + 1, np.int64)
    position, velocity = np.empty(3), np.empty(3)
    for epoch in range(t_s.size):
        start = first_row[epoch]
        first, last = columns.first_row[epoch], columns.first_row[epoch + 1]
        count = _choose(first, last, columns.satellite, columns.signal, columns.pseudorange_m, ranks, rows[start:])
        first_row[epoch + 1] = start + count
        for row in rows[start : start + count]:
            row.signal, row.system = columns.signal[row.source], row.satellite // 100
            row.pseudorange_m = columns.pseudorange_m[row.source]
            row.ephemeris = select_row(ephemerides, first_ephemeris, row.satellite, t_s[epoch])
            row.rejection = _REFUSED if refused[epoch] else _screen(row)
            row.carrier_hz = _carrier_hz(row, ephemerides)
            rate_mps = -LIGHT_MPS / row.carrier_hz * columns.doppler_hz[row.source]
            row.range_rate_mps = rate_mps if abs(rate_mps) < FASTEST_RANGE_RATE_MPS else np.nan
            row.carrier_m = LIGHT_MPS / row.carrier_hz * columns.carrier_phase_cycles[row.source]
            row.lock_lost = columns.lock_lost[row.source]
            density = columns.cn0_dbhz[row.source]
            row.cn0_dbhz = density if 0.0 < density < STRONGEST_DBHZ else np.nan
            row.strength_dbhz = row.cn0_dbhz
            if not refused[epoch]:
                row.strength_dbhz = _average_strength(row, t_s[epoch], averaging_s, known[row.satellite])
            _place_satellite(row, t_s[epoch], ephemerides, position, velocity)
    return first_row


def prepare(
    observations: Observations, refused: Bools, table: EphemerisTable, systems: str, strengths: SignalStrengths
) -> Prepared:
    """Rows of the selected `systems` (letters of PREFERRED_SIGNALS) with satellites and first rejections.

    Of a satellite's signals the first preferred one with a pseudorange counts, of a signal that
    stands twice in an epoch the first. Impossible Dopplers and C/N0 count as missing. Epochs that
    are `refused` change nothing in `strengths`.
    """
    columns = Columns(
        np.array(observations.first_row, np.int64),
        np.array(observations.satellite, np.int64),
        np.array(observations.signal, np.int64),
        np.array(observations.pseudorange_m, np.float64),
        np.array(observations.doppler_hz, np.float64),
        np.array(observations.cn0_dbhz, np.float64),
        np.array(observations.carrier_phase_cycles, np.float64),
        np.array(observations.lock_lost, np.float64),
    )
    t_s = (observations.gps_week - table.gps_week) * float(WEEK_S) + observations.tow_s
    rows = np.zeros(columns.satellite.size, ROW)
    ranks = _ranks(observations.signals, systems)
    first_row = _prepare(
        columns, t_s, refused, ranks, table.rows, table.first, strengths.averaging_s, strengths.known, rows
    )
    return Prepared(t_s, t_s + table.gps_week * float(WEEK_S), first_row, rows[: first_row[-1]])
