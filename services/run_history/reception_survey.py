"""How well a line is received, by place: missing fixes and missing speeds (before devices are installed for good)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
STRETCH_M: Final = 250.0
LATE: Final = 1.5
"""A fix that comes later than this many usual intervals has missing ones before it."""


@dataclass(frozen=True, slots=True)
class Reception:
    """A stretch of the line over all runs."""

    start_axis_m: float
    end_axis_m: float
    fixes: int
    without_speed: int
    missing_s: float
    """Time without any fix, of gaps that begin here."""
    longest_gap_s: float

    @property
    def without_speed_share(self) -> float:
        """Of the fixes there."""
        return self.without_speed / self.fixes if self.fixes else 0.0


def survey(runs: Iterable[tuple[Floats, Floats, Floats]]) -> list[Reception]:
    """Stretches of 250 m along the axis in order, from runs of (t_s, axis_m, speed_mps), each of shape (n,).

    Places off the line (NaN) count with the last place on it.
    """
    table: dict[int, list[float]] = {}
    for t_s, axis_m, speed_mps in runs:
        known = np.isfinite(axis_m)
        if known.sum() < 2:  # noqa: PLR2004 - an interval needs two
            continue
        last = np.maximum.accumulate(np.where(known, np.arange(len(t_s)), np.flatnonzero(known)[0]))
        stretch = np.floor(axis_m[last] / STRETCH_M).astype(np.int64)
        step = np.append(np.diff(t_s), 0.0)
        usual = float(np.median(step[:-1]))
        gap = np.where(step > LATE * usual, step - usual, 0.0)
        for k in np.unique(stretch):
            here = stretch == k
            row = table.setdefault(int(k), [0.0, 0.0, 0.0, 0.0])
            row[0] += int(here.sum())
            row[1] += int((~np.isfinite(speed_mps[here])).sum())
            row[2] += float(gap[here].sum())
            row[3] = max(row[3], float(gap[here].max()))
    return [
        Reception(k * STRETCH_M, (k + 1) * STRETCH_M, int(fixes), int(without), missing, longest)
        for k, (fixes, without, missing, longest) in sorted(table.items())
    ]
