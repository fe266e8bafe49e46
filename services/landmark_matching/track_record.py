"""The last minutes of curvature, kept for diagnoses that look back."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.landmark_matching.reading import Sample

Floats = NDArray[np.float64]

CAPACITY: Final = 8192
"""Samples; at ten per second some thirteen minutes, 2 km at the lowest speed at which curvature counts."""
T, DISTANCE, CURVATURE, SPEED, WINDOW, EXCESS, SIGMA = range(7)
COLUMNS: Final = 7


class TrackRecord:
    """Samples by their number, counted from the first one ever; the oldest are forgotten."""

    def __init__(self) -> None:
        """Start empty."""
        self._columns = np.zeros((COLUMNS, CAPACITY))
        self._faults: list[str] = []
        self._first = 0

    @property
    def end(self) -> int:
        """Number of the next sample."""
        return self._first + len(self._faults)

    @property
    def first(self) -> int:
        """Number of the oldest sample that is kept."""
        return self._first

    def add(self, sample: Sample) -> None:
        """Keep one more sample."""
        if len(self._faults) == CAPACITY:
            half = CAPACITY // 2
            self._columns[:, :half] = self._columns[:, half:]
            del self._faults[:half]
            self._first += half
        self._columns[:, len(self._faults)] = (
            sample.t_s,
            sample.distance_m,
            sample.curvature_per_m,
            sample.speed_mps,
            sample.window_m,
            sample.excess_m,
            sample.sigma_per_m,
        )
        self._faults.append(sample.fault)

    def column(self, which: int, begin: int, end: int) -> Floats:
        """View of one column from sample `begin` up to, without, `end`."""
        return self._columns[which, max(begin - self._first, 0) : end - self._first]

    def faults(self, begin: int, end: int) -> list[str]:
        """What was wrong with these samples."""
        return self._faults[max(begin - self._first, 0) : end - self._first]

    def since_distance(self, distance_m: float, end: int) -> int:
        """Number of the first of the newest samples before `end` that all lie at or beyond a distance."""
        before = np.flatnonzero(self._columns[DISTANCE, : end - self._first] < distance_m)
        return self._first + (int(before[-1]) + 1 if len(before) else 0)
