"""Observation fields into numbers: the one loop that touches every character.

A field is F14.3 with a loss-of-lock digit and a strength digit (RINEX 2.11 table A2, RINEX 3.05
table A3). The decimal point must stand in its place: in a shifted or cut line it does not, and the
field is refused instead of read wrongly. The digits without the point make an integer below 2^53,
so that one division gives the nearest double, the same as float() of the text.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from services.gnss_receiver.observations import SYSTEMS
from services.gnss_receiver.rinex_lines import Ints, Lines
from services.gnss_receiver.rinex_signals import Layout

_POINT, _SPACE, _ZERO, _NINE, _MINUS, _PLUS = 0x2E, 0x20, 0x30, 0x39, 0x2D, 0x2B
_MAX_LOCK = 7
"""Bits 0 to 2 (RINEX 2.11, table A2)."""
_BATCH = 1 << 15
_MAX_BAD = 4096
REPEATED = -1
_SATELLITES = 100 * len(SYSTEMS)


@dataclass(frozen=True, slots=True)
class Records:
    """Satellites of accepted epochs, in file order; columns of shape (records,)."""

    line: Ints
    """Index of the satellite's (first) observation line."""
    table: Ints
    """Index of its table in the Layout."""
    epoch: Ints
    satellite: Ints


@dataclass(frozen=True, slots=True)
class Rows:
    """One row per record and signal with anything measured."""

    rows_of_epoch: Ints
    satellite: NDArray[np.uint16]
    signal: NDArray[np.uint8]
    values: NDArray[np.float64]
    """Shape (4, rows), in the order of QUANTITIES."""
    lock_lost: NDArray[np.uint8]
    bad: Ints
    """Shape (n, 3): record, entry of the layout, quantity (-1: the satellite stood in the epoch before)."""
    bad_count: int


@njit(cache=True, nogil=True)
def _read_rows(  # noqa: C901, PLR0912, PLR0915 - one pass over the characters; a call per field costs compile time
    buffer: NDArray[np.uint8],
    starts: Ints,
    ends: Ints,
    line_of: Ints,
    table_of: Ints,
    epoch_of: Ints,
    satellite_of: Ints,
    first: Ints,
    signal_of: NDArray[np.uint8],
    line_add: Ints,
    offset: Ints,
    divisor: NDArray[np.float64],
    seen: Ints,
    rows_of_epoch: Ints,
    satellite: NDArray[np.uint16],
    signal: NDArray[np.uint8],
    values: NDArray[np.float64],
    lock_lost: NDArray[np.uint8],
    bad: Ints,
    begin: int,
    stop: int,
    row: int,
    bads: int,
) -> tuple[int, int]:
    """Read the records `begin:stop` into the columns from `row` on; gives the next row and the refusals so far."""
    for record in range(begin, stop):
        code = satellite_of[record]
        if seen[code] == epoch_of[record]:
            if bads < len(bad):
                bad[bads, 0], bad[bads, 1], bad[bads, 2] = record, 0, REPEATED
            bads += 1
            continue
        seen[code] = epoch_of[record]
        emitted = -1
        for entry in range(first[table_of[record]], first[table_of[record] + 1]):
            if signal_of[entry] == emitted:
                continue
            any_measured = False
            lock = 0
            for quantity in range(4):
                values[quantity, row] = np.nan
                if offset[entry, quantity] < 0:
                    continue
                line = line_of[record] + line_add[entry, quantity]
                end = ends[line]
                at = starts[line] + offset[entry, quantity]
                point = at + 10
                good = True
                mantissa = 0
                if point + 4 <= end and buffer[point] == _POINT:
                    k = at
                    while buffer[k] == _SPACE:
                        k += 1
                    negative = buffer[k] == _MINUS
                    if negative or buffer[k] == _PLUS:
                        k += 1
                    while k < point + 4:
                        if k != point:
                            digit = int(buffer[k]) - _ZERO
                            good = good and 0 <= digit < 10  # noqa: PLR2004 - the ten digits
                            mantissa = 10 * mantissa + digit
                        k += 1
                    if negative:
                        mantissa = -mantissa
                else:
                    for k in range(at, min(point + 4, end)):
                        good = good and buffer[k] == _SPACE
                for k in range(at + 14, min(at + 16, end)):
                    good = good and (buffer[k] == _SPACE or _ZERO <= buffer[k] <= _NINE)
                if not good:
                    if bads < len(bad):
                        bad[bads, 0], bad[bads, 1], bad[bads, 2] = record, entry, quantity
                    bads += 1
                    continue
                if quantity == 1 and at + 14 < end and buffer[at + 14] != _SPACE:
                    lock = int(buffer[at + 14]) - _ZERO
                if mantissa != 0:
                    values[quantity, row] = mantissa / divisor[entry, quantity]
                    any_measured = True
            if any_measured:
                satellite[row] = code
                signal[row] = signal_of[entry]
                lock_lost[row] = lock if lock <= _MAX_LOCK else 0
                emitted = signal_of[entry]
                rows_of_epoch[epoch_of[record]] += 1
                row += 1
    return row, bads


def read_rows(lines: Lines, records: Records, layout: Layout, epochs: int, progress: Callable[[float], None]) -> Rows:
    """Rows of all records; a field that cannot be read is NaN and stands in `bad`.

    Of a satellite that an epoch lists twice, the first is taken. `progress` gets the fraction done.
    """
    entries = np.diff(layout.first)
    room = int(entries[records.table].sum())
    count = len(records.line)
    rows_of_epoch = np.zeros(epochs, np.int64)
    satellite, signal = np.zeros(room, np.uint16), np.zeros(room, np.uint8)
    values, lock_lost = np.empty((4, room)), np.zeros(room, np.uint8)
    bad, seen = np.zeros((_MAX_BAD, 3), np.int64), np.full(_SATELLITES, -1, np.int64)
    row = bads = 0
    for begin in range(0, count, _BATCH):
        stop = min(begin + _BATCH, count)
        row, bads = _read_rows(
            lines.buffer,
            lines.starts,
            lines.ends,
            records.line,
            records.table,
            records.epoch,
            records.satellite,
            layout.first,
            layout.signal,
            layout.line,
            layout.offset,
            layout.divisor,
            seen,
            rows_of_epoch,
            satellite,
            signal,
            values,
            lock_lost,
            bad,
            begin,
            stop,
            row,
            bads,
        )
        progress(stop / count)
    return Rows(
        rows_of_epoch, satellite[:row], signal[:row], values[:, :row], lock_lost[:row], bad[: min(bads, _MAX_BAD)], bads
    )
