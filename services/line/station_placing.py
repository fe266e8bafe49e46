"""Stations placed along a line that was put together from a map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FARTHEST_M: Final = 300.0
"""A station further from every way of the line is not this line's."""
SAME_M: Final = 400.0
"""Stations of one name this near to each other are one."""

BRANCH_HANDICAP_M: Final = 20.0
"""By so much a branch must be nearer than the main line."""


@dataclass(frozen=True, slots=True)
class MapStation:
    """A station as the map has it."""

    name: str
    name_ja: str
    place_m: Floats
    """Shape (2,): in the plane of the line."""
    chainage_m: float | None


@dataclass(frozen=True, slots=True)
class PlacedStation:
    """Where it falls."""

    station: MapStation
    way: int
    """0 the main line, then the branches."""
    along_m: float
    aside_m: float


def place(
    stations: Sequence[MapStation], ways: Sequence[tuple[Floats, Floats]]
) -> tuple[tuple[PlacedStation, ...], tuple[str, ...]]:
    """Stations on the nearest of some ways (places along (n,), vertices (n, 2)), and notes about those left out.

    The main line, the first way, is preferred where two ways run side by side.
    """
    placed: list[PlacedStation] = []
    notes: list[str] = []
    for station in stations:
        feet = [foot(station.place_m, along, plane) for along, plane in ways]
        way = min(range(len(ways)), key=lambda k: (feet[k][1] + (0.0 if k == 0 else BRANCH_HANDICAP_M), k))
        along_m, aside_m = feet[way]
        again = [one for one in placed if _is_same(one.station, station)]
        if aside_m > FARTHEST_M:
            notes.append(f"station {station.name or '?'} is {aside_m:.0f} m from the line and is left out")
        elif not again:
            placed.append(PlacedStation(station, way, along_m, aside_m))
    return tuple(sorted(placed, key=lambda one: (one.way, one.along_m))), tuple(notes)


def _is_same(one: MapStation, other: MapStation) -> bool:
    return one.name == other.name and float(np.hypot(*(one.place_m - other.place_m))) <= SAME_M


def foot(place_m: Floats, along: Floats, plane: Floats) -> tuple[float, float]:
    """Place along a way (along (n,), vertices (n, 2)) that is nearest to a point (2,), and its distance."""
    start, step = plane[:-1], np.diff(plane, axis=0)
    share = np.clip(((place_m - start) * step).sum(axis=1) / np.maximum((step**2).sum(axis=1), 1e-12), 0.0, 1.0)
    distance = np.hypot(*(place_m - start - share[:, None] * step).T)
    k = int(distance.argmin())
    return float(along[k] + share[k] * (along[k + 1] - along[k])), float(distance[k])


def rises_with_line(placed: Sequence[PlacedStation], order: Sequence[MapStation]) -> bool | None:
    """Whether kilometrage, or else the stations' order in the file, rises with the line; None when neither says."""
    main = [one for one in placed if one.way == 0]
    known = [one for one in main if one.station.chainage_m is not None]
    if len(known) >= 2:  # noqa: PLR2004 - a direction needs two places
        along = np.array([one.along_m for one in known])
        rank = np.array([one.station.chainage_m for one in known], float)
    elif len(main) >= 2:  # noqa: PLR2004 - the same
        along = np.array([one.along_m for one in main])
        rank = np.array([next(k for k, station in enumerate(order) if station is one.station) for one in main], float)
    else:
        return None
    agreement = float(((along - along.mean()) * (rank - rank.mean())).sum())
    return agreement > 0.0 if agreement else None
