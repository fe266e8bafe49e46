"""Samples of one sensor as its blocks bring them: in order, each once, faulty ones left out."""

from __future__ import annotations

from collections import Counter
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.motion import ImuBlock, TachoBlock
from services.odometry_fusion.motion_log import Counts

UNUSABLE: Final = ("saturated", "frozen")
"""Faults of an inertial sensor after which its samples show no motion."""
LEAP_NS: Final = 60_000_000_000
"""A sensor whose time leaps on by more, or back for good, has another clock."""
MOST_BACK: Final = 30
"""Blocks in a row from the past after which the clock is taken for set back."""


class SampleBuffer:
    """Holds the samples of one sensor that are not used yet."""

    def __init__(self, name: str, counts: Counter[str]) -> None:
        """Begin empty; `counts` counts what is refused."""
        self._name = name
        self._counts = counts
        self._t_ns: list[Counts] = []
        self._values: list[NDArray[np.generic]] = []
        self._next_sample: int | None = None
        self._back = 0
        self.last_ns: int | None = None
        self.leapt = False
        """The sensor's clock has been set; what came before does not belong to what comes now."""

    def add_imu(self, block: ImuBlock) -> None:
        """Take an inertial block in."""
        columns = (block.ax_mps2, block.ay_mps2, block.az_mps2, block.gx_radps, block.gy_radps, block.gz_radps)
        values = np.column_stack(columns)
        usable: NDArray[np.bool_] = np.zeros(len(values), np.bool_)
        if not block.fault.startswith(UNUSABLE):
            usable |= np.isfinite(values).all(axis=1)
        if not usable.all():
            self._counts[f"{self._name}_unusable"] += int((~usable).sum())
        self._add(block.t_ns, block.offset_ns, values, usable, block.first_sample)

    def add_tacho(self, block: TachoBlock) -> None:
        """Take a block of counts in."""
        self._add(block.t_ns, block.offset_ns, block.pulses, np.ones(len(block.pulses), np.bool_), block.first_sample)

    def _add(
        self, t_ns: int, offset_ns: Counts, values: NDArray[np.generic], usable: NDArray[np.bool_], first: int
    ) -> None:
        if not len(offset_ns):
            return
        times_ns = offset_ns.astype(np.int64) + t_ns
        risen = times_ns > np.r_[np.iinfo(np.int64).min, np.maximum.accumulate(times_ns)[:-1]]
        fresh = risen if self.last_ns is None else risen & (times_ns > self.last_ns)
        if self.last_ns is not None:
            self._watch_clock(t_ns)
        if self._next_sample is not None and first > self._next_sample:
            self._counts[f"{self._name}_samples_missing"] += first - self._next_sample
        self._next_sample = first + len(offset_ns)
        if not fresh.all():
            self._counts[f"{self._name}_late_or_repeated"] += int((~fresh).sum())
        kept = fresh & usable
        if fresh.any():
            self.last_ns = int(times_ns[fresh][-1])
        if kept.any():
            self._t_ns.append(times_ns[kept])
            self._values.append(values[kept])

    def _watch_clock(self, t_ns: int) -> None:
        last_ns = self.last_ns if self.last_ns is not None else t_ns
        self._back = self._back + 1 if t_ns <= last_ns else 0
        if t_ns > last_ns + LEAP_NS or self._back >= MOST_BACK:
            self.leapt = True

    def take(self) -> tuple[Counts, list[NDArray[np.generic]]]:
        """Times and values not taken yet."""
        times_ns = np.concatenate(self._t_ns) if self._t_ns else np.empty(0, np.int64)
        values, self._t_ns, self._values = self._values, [], []
        return times_ns, values
