"""Epochs put together from the Multiple Signal Messages that speak of one instant."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from schemas.arrays import Float64s
from schemas.gnss import Epoch
from services.gnss_receiver.carrier_frequency import signal_hz
from services.gnss_receiver.lock_times import HALF_CYCLE, LOST, LockTimes
from services.gnss_receiver.rtcm_msm import MsmCells
from services.gnss_receiver.rtcm_time import WEEK_MS, unix_ns_from_gps_ms

_LIGHT_MPS: Final = 299_792_458.0
_PATIENCE: Final = 3
"""So many epochs in a row whose end was announced too early show that the sender's announcements mean nothing."""


@dataclass(slots=True)
class _Rows:
    """Cells of one epoch so far."""

    gps_ms: int
    names: list[tuple[str, str]] = field(default_factory=list)
    columns: list[tuple[Float64s, ...]] = field(default_factory=list)
    lock_lost: list[int] = field(default_factory=list)


class EpochAssembler:
    """Collects messages and gives an epoch when its last one has come.

    The multiple-message bit says which is the last. Where that one is missing, the first message
    of the next epoch ends this one. A sender that announces the end too early several times is
    believed no more: its epochs end with the beginning of the next.
    """

    def __init__(self, counts: Counter[str]) -> None:
        """Hold nothing; what is noticed is counted in `counts`."""
        self._counts = counts
        self._open: _Rows | None = None
        self._given: tuple[int, frozenset[tuple[str, str]]] | None = None
        self._early_ends = 0
        self._ended_early = False
        self._locks = LockTimes()

    def add(self, cells: MsmCells, gps_ms: int, channels: Mapping[str, int]) -> list[Epoch]:
        """Epochs that are complete now. `channels` are the GLONASS frequency channels by satellite."""
        epochs: list[Epoch] = []
        if self._open is not None and self._open.gps_ms != gps_ms:
            if self._early_ends < _PATIENCE:
                self._counts["epochs_without_end"] += 1
            epochs.append(self._close(self._open))
        if self._is_late(cells, gps_ms):
            return epochs
        rows = self._open if self._open is not None else _Rows(gps_ms)
        self._open = rows
        self._take(rows, cells, channels)
        if not cells.more and self._early_ends < _PATIENCE:
            epochs.append(self._close(rows))
        return epochs

    def cut(self) -> list[Epoch]:
        """What is there of an epoch whose end will not come: the connection ended."""
        return [] if self._open is None else [self._close(self._open)]

    def _is_late(self, cells: MsmCells, gps_ms: int) -> bool:
        """Whether the epoch of `cells` has been given already; repetitions are no fault of the sender's."""
        if self._open is not None or self._given is None or self._given[0] != gps_ms:
            return False
        if set(zip(cells.satellites, cells.signals, strict=True)) <= self._given[1]:
            self._counts["repeated_messages"] += 1
        else:
            self._counts["messages_after_end"] += 1
            self._ended_early = True
        return True

    def _take(self, rows: _Rows, cells: MsmCells, channels: Mapping[str, int]) -> None:
        known = set(rows.names)
        names = list(zip(cells.satellites, cells.signals, strict=True))
        fresh = [index for index, name in enumerate(names) if name not in known]
        if len(fresh) < len(names):
            self._counts["repeated_cells"] += len(names) - len(fresh)
        if cells.unknown:
            self._counts["unknown_cells"] += cells.unknown
        hz = np.array([signal_hz(sat[0], sig, channels.get(sat)) or np.nan for sat, sig in names], np.float64)
        cycles = cells.phase_range_m * hz / _LIGHT_MPS
        doppler_hz = -cells.range_rate_mps * hz / _LIGHT_MPS
        rows.names += [names[index] for index in fresh]
        rows.columns.append(tuple(part[fresh] for part in (cells.pseudorange_m, cycles, doppler_hz, cells.cn0_dbhz)))
        for index in fresh:
            lost = 0
            if np.isfinite(cells.phase_range_m[index]):
                since, below = float(cells.lock_s[index]), float(cells.lock_below_s[index])
                lost = LOST * self._locks.lost(*names[index], rows.gps_ms, since, below)
                lost |= HALF_CYCLE * int(cells.half_cycle[index])
            rows.lock_lost.append(lost)

    def _close(self, rows: _Rows) -> Epoch:
        self._open = None
        if self._given is not None and rows.gps_ms <= self._given[0]:
            self._counts["time_jumps_back"] += 1
        if self._early_ends < _PATIENCE:
            self._early_ends = self._early_ends + 1 if self._ended_early else 0
        self._ended_early = False
        self._given = rows.gps_ms, frozenset(rows.names)
        week, tow_ms = divmod(rows.gps_ms, WEEK_MS)
        pseudorange_m, cycles, doppler_hz, cn0_dbhz = (
            np.concatenate([np.empty(0), *(columns[at] for columns in rows.columns)]) for at in range(4)
        )
        return Epoch(
            t_ns=unix_ns_from_gps_ms(rows.gps_ms),
            gps_week=week,
            tow_s=tow_ms / 1000.0,
            satellites=tuple(satellite for satellite, _ in rows.names),
            signals=tuple(signal for _, signal in rows.names),
            pseudorange_m=pseudorange_m,
            carrier_phase_cycles=cycles,
            doppler_hz=doppler_hz,
            cn0_dbhz=cn0_dbhz,
            lock_lost=np.array(rows.lock_lost, np.uint8),
        )
