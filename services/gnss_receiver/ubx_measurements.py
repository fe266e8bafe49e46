"""Epochs from UBX-RXM-RAWX.

Source: u-blox F9 HPG 1.32 interface description, 1.5.4 (signals), 3.17.5 (RXM-RAWX).
"""

from __future__ import annotations

from collections import Counter
from typing import Final

import numpy as np

from schemas.gnss import Epoch
from schemas.gnss_time import WEEK_S, unix_ns_from_gps
from services.gnss_receiver.lock_times import HALF_CYCLE, LOST, LockTimes

_HEAD: Final = 16
_ROW: Final = np.dtype(
    [
        ("pseudorange_m", "<f8"),
        ("phase_cycles", "<f8"),
        ("doppler_hz", "<f4"),
        ("system", "u1"),
        ("satellite", "u1"),
        ("signal", "u1"),
        ("channel", "u1"),
        ("lock_ms", "<u2"),
        ("cn0_dbhz", "u1"),
        ("range_deviation", "u1"),
        ("phase_deviation", "u1"),
        ("doppler_deviation", "u1"),
        ("tracking", "u1"),
        ("reserved", "u1"),
    ]
)
_RANGE_VALID, _PHASE_VALID, _HALF_CYCLE_KNOWN = 1, 2, 4
_CLOCK_RESET: Final = 2
"""Bit of the receiver status: the receiver set its clock by whole milliseconds; phases begin anew."""
_LONGEST_LOCK_MS: Final = 64_500
_LOCK_STEP_S: Final = 1.0
"""The counter may lag by the interval of measurements; what lags by less is no loss."""

SYSTEMS: Final = {0: "G", 1: "S", 2: "E", 3: "C", 5: "J", 6: "R", 7: "I"}
_SIGNALS: Final = {
    "G": {0: "1C", 3: "2L", 4: "2S", 6: "5I", 7: "5Q"},
    "S": {0: "1C"},
    "E": {0: "1C", 1: "1B", 3: "5I", 4: "5Q", 5: "7I", 6: "7Q", 8: "6B", 9: "6C", 10: "6A"},
    "C": {0: "2I", 1: "2I", 2: "7I", 3: "7I", 4: "6I", 5: "1P", 6: "1D", 7: "5P", 8: "5D", 10: "6I"},
    "J": {0: "1C", 1: "1Z", 4: "2S", 5: "2L", 8: "5I", 9: "5Q", 12: "1E"},
    "R": {0: "1C", 2: "2C"},
    "I": {0: "5A"},
}
_FIRST_SBAS: Final = 100
_MOST_NUMBERS: Final = {"G": 32, "S": 58, "E": 36, "C": 63, "J": 10, "R": 27, "I": 14}


def satellite_name(system: str, number: int) -> str | None:
    """RINEX 3 name of a satellite by u-blox's number; None for one that is not known (GLONASS 255)."""
    number -= _FIRST_SBAS if system == "S" else 0
    return f"{system}{number:02d}" if 1 <= number <= _MOST_NUMBERS[system] else None


class RawMeasurements:
    """Turns measurements into epochs; remembers how long carriers have been locked."""

    def __init__(self, counts: Counter[str]) -> None:
        """What is noticed is counted in `counts`."""
        self._counts = counts
        self._locks = LockTimes()

    def epoch(self, message: bytes) -> Epoch:
        """Epoch of an RXM-RAWX message (without class and identity).

        Satellites and signals that have no name are left out and counted. Raises ValueError for a
        message that is cut short and for a time that cannot be.
        """
        if len(message) < _HEAD or len(message) < _HEAD + message[11] * _ROW.itemsize:
            msg = f"RXM-RAWX of {len(message)} bytes is cut short"
            raise ValueError(msg)
        tow_s = float(np.frombuffer(message, "<f8", 1)[0])
        week, status = int.from_bytes(message[8:10], "little"), message[12]
        if not 0.0 <= tow_s < WEEK_S + 1 or week == 0:
            msg = f"RXM-RAWX at second {tow_s} of week {week}: the receiver does not know the time yet"
            raise ValueError(msg)
        over, tow_s = divmod(tow_s, WEEK_S)
        week += int(over)
        rows = np.frombuffer(message, _ROW, message[11], _HEAD)
        names = [_names(*row) for row in zip(rows["system"], rows["satellite"], rows["signal"], strict=True)]
        kept = [index for index, name in enumerate(names) if name is not None]
        if len(kept) < len(names):
            self._counts["unknown_signals"] += len(names) - len(kept)
        named = [name for name in names if name is not None]
        rows = rows[kept]
        tracking = rows["tracking"]
        phase = np.where((tracking & _PHASE_VALID > 0) & (rows["phase_cycles"] != 0.0), rows["phase_cycles"], np.nan)
        pseudorange_m = np.where(tracking & _RANGE_VALID > 0, rows["pseudorange_m"], np.nan)
        return Epoch(
            t_ns=unix_ns_from_gps(week, tow_s),
            gps_week=week,
            tow_s=tow_s,
            satellites=tuple(satellite for satellite, _ in named),
            signals=tuple(signal for _, signal in named),
            pseudorange_m=pseudorange_m.astype(np.float64),
            carrier_phase_cycles=phase.astype(np.float64),
            doppler_hz=rows["doppler_hz"].astype(np.float64),
            cn0_dbhz=np.where(rows["cn0_dbhz"] > 0, rows["cn0_dbhz"], np.nan).astype(np.float64),
            lock_lost=self._lock_lost(named, rows, phase, round(1000 * (week * WEEK_S + tow_s)), status),
        )

    def _lock_lost(
        self,
        names: list[tuple[str, str]],
        rows: np.ndarray[tuple[int], np.dtype[np.void]],
        phase: np.ndarray[tuple[int], np.dtype[np.float64]],
        gps_ms: int,
        status: int,
    ) -> np.ndarray[tuple[int], np.dtype[np.uint8]]:
        flags = np.zeros(len(names), np.uint8)
        for index, (satellite, signal) in enumerate(names):
            if np.isnan(phase[index]):
                continue
            lock_ms = int(rows["lock_ms"][index])
            below_s = np.inf if lock_ms >= _LONGEST_LOCK_MS else lock_ms / 1000.0 + _LOCK_STEP_S
            lost = self._locks.lost(satellite, signal, gps_ms, lock_ms / 1000.0, below_s)
            half = not rows["tracking"][index] & _HALF_CYCLE_KNOWN
            flags[index] = LOST * (lost or bool(status & _CLOCK_RESET)) | HALF_CYCLE * half
        return flags


def _names(system: int, satellite: int, signal: int) -> tuple[str, str] | None:
    letter = SYSTEMS.get(int(system))
    if letter is None:
        return None
    name, code = satellite_name(letter, int(satellite)), _SIGNALS[letter].get(int(signal))
    return (name, code) if name and code else None
