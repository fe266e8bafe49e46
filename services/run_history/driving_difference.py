"""What runs do differently (Maki et al., sections 4.2 and 4.5).

How far they accelerate on each hill of speed, where they brake and accelerate again, and in what the
energy-saving run differs from the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
HILL_MPS: Final = 10.0 / 3.6
"""A hill rises and falls by so much; less is driving about one speed."""
AGAIN_MPS: Final = 10.0 / 3.6
USUAL_SHARE: Final = 0.5
"""A dip that half of the population makes at a place is the line's (a restriction), not the driver's."""
SAME_PLACE_M: Final = 250.0
APPROACH_M: Final = 500.0
LIMITED_MPS: Final = 5.0 / 3.6
"""A restriction lies so much below the highest limit of the leg."""


@dataclass(frozen=True, slots=True)
class Turn:
    """A place where speed stops rising or falling, after having changed enough."""

    index: int
    rises: bool
    """A peak (speed rose until here), else a trough."""


def turns_of(speed_mps: Floats, least_mps: float) -> list[Turn]:
    """Peaks and troughs in turn, each at least `least_mps` from the one before; shape (n,) of speeds."""
    found: list[Turn] = []
    rising, extreme = True, 0
    for k in range(1, len(speed_mps)):
        v, best = speed_mps[k], speed_mps[extreme]
        if (v >= best) if rising else (v <= best):
            extreme = k
        elif abs(v - best) >= least_mps:
            found.append(Turn(extreme, rising))
            rising, extreme = not rising, k
    return found


@dataclass(frozen=True, slots=True)
class Hill:
    """A stretch between two troughs of the median speed, and the speeds at which runs stop accelerating on it."""

    start_m: float
    end_m: float
    peaks_mps: Floats
    """Shape (runs,)."""

    @property
    def spread_mps(self) -> float:
        """Highest less lowest."""
        return float(np.ptp(self.peaks_mps))


def hills_of(speeds_mps: Floats, grid_m: Floats) -> list[Hill]:
    """Hills of a population of shape (runs, places); none without runs."""
    if len(speeds_mps) == 0:
        return []
    turns = turns_of(np.median(speeds_mps, axis=0), HILL_MPS)
    edges = [0, *(turn.index for turn in turns if not turn.rises), len(grid_m) - 1]
    return [
        Hill(float(grid_m[a]), float(grid_m[b]), speeds_mps[:, a : b + 1].max(axis=1))
        for a, b in pairwise(edges)
        if b > a
    ]


@dataclass(frozen=True, slots=True)
class Reacceleration:
    """Braked, and accelerated again."""

    at_m: float
    from_mps: float
    low_mps: float
    to_mps: float


def reaccelerations(speeds_mps: Floats, grid_m: Floats) -> list[tuple[Reacceleration, ...]]:
    """By run: dips of 10 km/h and more that at most half of the population makes there."""
    dips: list[list[Reacceleration]] = []
    for run in speeds_mps:
        turns = turns_of(run, AGAIN_MPS)
        found = []
        for k, turn in enumerate(turns):
            if turn.rises or k == 0:
                continue
            ahead = turns[k + 1].index if k + 1 < len(turns) else len(run) - 1
            peaks = float(run[turns[k - 1].index]), float(run[turn.index : ahead + 1].max())
            found.append(Reacceleration(float(grid_m[turn.index]), peaks[0], float(run[turn.index]), peaks[1]))
        dips.append(found)
    if len(dips) < 2:  # noqa: PLR2004 - alone, nothing tells a restriction from a habit
        return [() for _ in dips]

    places = np.array([dip.at_m for run in dips for dip in run])
    runs = np.array([number for number, run in enumerate(dips) for _ in run])
    # Places lie on the grid: few of them differ, however many runs there are.
    usual = {
        at: len(np.unique(runs[np.abs(places - at) <= SAME_PLACE_M])) > USUAL_SHARE * len(dips)
        for at in np.unique(places).tolist()
    }
    return [tuple(dip for dip in run if not usual[dip.at_m]) for run in dips]


@dataclass(frozen=True, slots=True)
class Difference:
    """The energy-saving run against the middle of the population."""

    top_mps: float
    top_others_mps: float
    limited_mps: float | None
    """Mean speed where the limit is lower than elsewhere; None where there is no such stretch, or no limit known."""
    limited_others_mps: float | None
    approach_mps: float
    """Speed 500 m before the stop."""
    approach_others_mps: float
    reaccelerations: int
    reaccelerations_others: float
    """Mean number."""


def difference_of(
    speeds_mps: Floats,
    grid_m: Floats,
    best: int,
    limit_mps: Floats | None,
    dips: Sequence[Sequence[Reacceleration]],
) -> Difference:
    """Difference of run `best` of a population (runs, places); limits have shape (places,), None: not known.

    `dips`: what `reaccelerations` gave for the population.
    """
    others = np.median(speeds_mps, axis=0)
    tops = speeds_mps.max(axis=1)
    again = [len(one) for one in dips]
    before = int(np.argmin(np.abs(grid_m - max(float(grid_m[-1]) - APPROACH_M, 0.0))))
    limited = limited_others = None
    if limit_mps is not None and np.isfinite(limit_mps).any():
        low = limit_mps < limit_mps.max() - LIMITED_MPS
        # Beside both stations trains are slow for another reason.
        low &= (grid_m > APPROACH_M) & (grid_m < grid_m[-1] - APPROACH_M)
        if low.any():
            limited, limited_others = float(speeds_mps[best, low].mean()), float(others[low].mean())
    return Difference(
        float(tops[best]),
        float(np.median(tops)),
        limited,
        limited_others,
        float(speeds_mps[best, before]),
        float(others[before]),
        again[best],
        float(np.mean(again)),
    )
