"""Kilometrage of a line: chainage_m at given places of the axis, interpolated between them.

A railway's kilometrage need not be its length: posts stand where they once stood. Between two given
places chainage is interpolated linearly. Where a chain is broken, two chainages are given for one
place: the first ends the piece before it, the second begins the next. Chainage may rise or fall
along the axis, and after a break a chainage may occur twice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

LARGEST_CHAINAGE_M: Final = 1e8
"""No railway's kilometrage counts further than this, to either side of its zero."""


class ChainageError(ValueError):
    """Given places that make no kilometrage; `place` counts from 0."""

    def __init__(self, place: int, text: str) -> None:
        """Name the place and what is wrong with it."""
        super().__init__(f"place {place + 1}: {text}")
        self.place = place
        self.text = text


@dataclass(frozen=True, slots=True)
class Chainage:
    """Chainages given along an axis. Made by `chainage_of`."""

    axis_m: Floats
    """Shape (n,), never falling; twice the same at a broken chain."""
    chainage_m: Floats
    """Shape (n,)."""

    def at(self, axis_m: ArrayLike) -> Floats:
        """Chainage at places of the axis; beyond the given ones it goes on metre by metre.

        Exactly at a break it is that of the piece which begins there.
        """
        wanted = np.asarray(axis_m, float)
        piece = np.clip(np.searchsorted(self.axis_m, wanted, side="right") - 1, 0, len(self.axis_m) - 2)
        start_m, long_m = self.axis_m[piece], self.axis_m[piece + 1] - self.axis_m[piece]
        rise_m = self.chainage_m[piece + 1] - self.chainage_m[piece]
        share = np.clip((wanted - start_m) / np.where(long_m > 0.0, long_m, 1.0), 0.0, 1.0)
        end_m = self.axis_m[-1]
        beyond_m = np.minimum(wanted - self.axis_m[0], 0.0) + np.maximum(wanted - end_m, 0.0)
        return np.asarray(self.chainage_m[piece] + share * rise_m + beyond_m * self._direction())

    def places(self, chainage_m: float) -> tuple[float, ...]:
        """Every `axis_m` with this chainage, in rising order; none, one, or several after a broken chain."""
        found: list[float] = []
        for i in range(len(self.axis_m) - 1):
            long_m, rise_m = self.axis_m[i + 1] - self.axis_m[i], self.chainage_m[i + 1] - self.chainage_m[i]
            if long_m <= 0.0:
                continue
            share = (chainage_m - self.chainage_m[i]) / rise_m
            if 0.0 <= share <= 1.0:
                place = float(self.axis_m[i] + share * long_m)
                if not found or place > found[-1] + 1e-6:
                    found.append(place)
        return tuple(found)

    def reach_m(self, axis_m: float, bound_m: float) -> float:
        """How far in chainage the places within `bound_m` of a place may be from it, never less than `bound_m`."""
        here_m = float(self.at(axis_m))
        inside = np.abs(self.axis_m - axis_m) <= bound_m
        far = self.at(np.array([axis_m - bound_m, axis_m + bound_m]))
        return max(bound_m, float(np.abs(np.concatenate([far, self.chainage_m[inside]]) - here_m).max()))

    def _direction(self) -> float:
        """1 where chainage rises with the axis on the whole, else -1."""
        return 1.0 if self.chainage_m[-1] >= self.chainage_m[0] else -1.0


def chainage_of(axis_m: ArrayLike, chainage_m: ArrayLike) -> Chainage:
    """Kilometrage through given places, both of shape (n,), n of at least 2, places in rising order.

    Raises ChainageError for places out of order, more than two chainages at one, stretches along
    which chainage stands still, and chainages beyond LARGEST_CHAINAGE_M.

    >>> float(chainage_of([0.0, 100.0], [5000.0, 5099.0]).at(50.0))
    5049.5
    """
    places, given = np.asarray(axis_m, float), np.asarray(chainage_m, float)
    if len(places) < 2:  # noqa: PLR2004 - between two places there is a piece
        raise ChainageError(0, "a kilometrage needs two places")
    for i in range(len(places)):
        if not (np.isfinite(places[i]) and np.isfinite(given[i])):
            raise ChainageError(i, "no number")
        if abs(given[i]) > LARGEST_CHAINAGE_M:
            raise ChainageError(i, f"chainage {given[i]:g} m is none: kilometrage is stated in metres")
        if i > 0 and places[i] < places[i - 1]:
            raise ChainageError(i, f"axis_m {places[i]:g} after {places[i - 1]:g}")
        if i > 0 and places[i] > places[i - 1] and given[i] == given[i - 1]:
            raise ChainageError(i, f"chainage stands still at {given[i]:g} m")
        if i > 1 and places[i] == places[i - 2]:
            raise ChainageError(i, f"more than two chainages at axis_m {places[i]:g}")
    if places[0] == places[1] or places[-1] == places[-2]:
        raise ChainageError(0 if places[0] == places[1] else len(places) - 1, "a chain breaks at the end of the line")
    return Chainage(places, given)
