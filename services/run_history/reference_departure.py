"""Places where logs repeatedly leave the reference (a monitor record of the same run) by more than 5 km/h."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.run_history.speed_trace import SpeedTrace, grid_over, speeds_on

Floats = NDArray[np.float64]
LEAVES_MPS: Final = 5.0 / 3.6
STRETCH_M: Final = 100.0
ENDS_M: Final = 200.0
"""Beside stops a few metres of place are more than 5 km/h of speed: nothing is said there."""
REPEATED_SHARE: Final = 0.3
REPEATED_RUNS: Final = 2


@dataclass(frozen=True, slots=True)
class Departure:
    """A stretch from the departure station on where several runs leave their reference."""

    start_m: float
    end_m: float
    runs: int
    of_runs: int
    largest_mps: float


def departures(pairs: Sequence[tuple[SpeedTrace, SpeedTrace]], length_m: float) -> list[Departure]:
    """Stretches of 100 m, neighbours as one, from pairs of (log, reference) of the same leg.

    A stretch counts where at least two runs and 30 % of them differ by more than 5 km/h.
    """
    if len(pairs) < REPEATED_RUNS:
        return []
    grid = grid_over(length_m)
    apart = np.stack([np.abs(speeds_on(log, grid) - speeds_on(reference, grid)) for log, reference in pairs])
    apart[:, (grid < ENDS_M) | (grid > length_m - ENDS_M)] = 0.0
    stretch = np.floor(grid / STRETCH_M).astype(np.int64)
    worst = np.stack([apart[:, stretch == k].max(axis=1) for k in range(int(stretch[-1]) + 1)], axis=1)
    leaves = worst > LEAVES_MPS
    often = (leaves.sum(axis=0) >= REPEATED_RUNS) & (leaves.mean(axis=0) >= REPEATED_SHARE)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], often.astype(np.int64), [0]))))
    return [
        Departure(
            float(a * STRETCH_M),
            float(min(b * STRETCH_M, length_m)),
            int(leaves[:, a:b].any(axis=1).sum()),
            len(pairs),
            float(worst[:, a:b].max()),
        )
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]
