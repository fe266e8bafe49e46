"""A whole recording of one receiver as columns, and single epochs of it as messages."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schemas.gnss import Ephemeris, Epoch, Ionosphere
from schemas.gnss_time import unix_ns_from_gps

SYSTEMS = "GRECJSI"


@dataclass(frozen=True, slots=True)
class FileIssue:
    """Something in a file that was refused, and where."""

    path: str
    line: int
    """Counted from 1; 0 for the file as a whole."""
    text: str

    def __str__(self) -> str:
        """Path, line and what was wrong, as compilers print it."""
        return f"{self.path}:{self.line}: {self.text}" if self.line else f"{self.path}: {self.text}"


@dataclass(frozen=True, slots=True)
class Observations:
    """Every epoch of one receiver; one row per epoch, satellite and signal.

    Rows of epoch i are `first_row[i]:first_row[i + 1]`. Epochs stand in file order, repeated and
    out-of-order ones included; what reads them decides. NaN where nothing was measured.
    """

    gps_week: NDArray[np.int64]
    """Shape (epochs,), by the receiver's clock."""
    tow_s: NDArray[np.float64]
    """Shape (epochs,), by the receiver's clock."""
    first_row: NDArray[np.int64]
    """Shape (epochs + 1,)."""
    satellite: NDArray[np.uint16]
    """Shape (rows,): 100 * index of the system in SYSTEMS + number."""
    signal: NDArray[np.uint8]
    """Shape (rows,): index into `signals`."""
    signals: tuple[str, ...]
    """RINEX 3 band and attribute, '1C'."""
    pseudorange_m: NDArray[np.float64]
    carrier_phase_cycles: NDArray[np.float64]
    doppler_hz: NDArray[np.float64]
    cn0_dbhz: NDArray[np.float64]
    lock_lost: NDArray[np.uint8]
    issues: tuple[FileIssue, ...] = ()

    def __len__(self) -> int:
        """Give the number of epochs."""
        return len(self.tow_s)

    def epoch(self, index: int) -> Epoch:
        """Epoch `index` as a message."""
        rows = slice(int(self.first_row[index]), int(self.first_row[index + 1]))
        week, tow_s = int(self.gps_week[index]), float(self.tow_s[index])
        return Epoch(
            t_ns=unix_ns_from_gps(week, tow_s),
            gps_week=week,
            tow_s=tow_s,
            satellites=tuple(satellite_name(code) for code in self.satellite[rows].tolist()),
            signals=tuple(self.signals[code] for code in self.signal[rows].tolist()),
            pseudorange_m=self.pseudorange_m[rows],
            carrier_phase_cycles=self.carrier_phase_cycles[rows],
            doppler_hz=self.doppler_hz[rows],
            cn0_dbhz=self.cn0_dbhz[rows],
            lock_lost=self.lock_lost[rows],
        )


@dataclass(frozen=True, slots=True)
class Navigation:
    """Broadcast orbits, clocks and ionosphere of one or more files, as they stand there."""

    ephemerides: tuple[Ephemeris, ...]
    ionosphere: Ionosphere | None = None
    issues: tuple[FileIssue, ...] = ()


def observations_of(epochs: Iterable[Epoch]) -> Observations:
    """Columns of single epochs, in their order."""
    whole = list(epochs)
    signals = tuple(sorted({signal for epoch in whole for signal in epoch.signals}))
    place = {signal: index for index, signal in enumerate(signals)}

    def column(name: str) -> NDArray[np.float64]:
        parts: list[NDArray[np.float64]] = [getattr(epoch, name) for epoch in whole]
        return np.concatenate([np.empty(0), *parts])

    return Observations(
        gps_week=np.array([epoch.gps_week for epoch in whole], np.int64),
        tow_s=np.array([epoch.tow_s for epoch in whole], np.float64),
        first_row=np.cumsum([0, *(len(epoch.satellites) for epoch in whole)], dtype=np.int64),
        satellite=np.array([satellite_code(name) for epoch in whole for name in epoch.satellites], np.uint16),
        signal=np.array([place[signal] for epoch in whole for signal in epoch.signals], np.uint8),
        signals=signals,
        pseudorange_m=column("pseudorange_m"),
        carrier_phase_cycles=column("carrier_phase_cycles"),
        doppler_hz=column("doppler_hz"),
        cn0_dbhz=column("cn0_dbhz"),
        lock_lost=np.concatenate([np.empty(0, np.uint8), *(epoch.lock_lost for epoch in whole)]),
    )


def satellite_code(name: str) -> int:
    """Number of a satellite in `Observations.satellite`.

    >>> satellite_code("E05")
    205
    """
    return 100 * SYSTEMS.index(name[0]) + int(name[1:])


def satellite_name(code: int) -> str:
    """RINEX 3 name of a satellite number.

    >>> satellite_name(205)
    'E05'
    """
    return f"{SYSTEMS[code // 100]}{code % 100:02d}"
