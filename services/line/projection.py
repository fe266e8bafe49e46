"""Places projected onto the axis: near the place before, or anywhere, with all candidates where the line nears itself.

Everything is in the plane of `Axis.plane_m`. The foot of a place on a polyline is the nearest point
of the nearest segment; it is looked for within a window of the axis around the place before, so that
a line which passes near itself is not confused with itself.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.line.axis import Axis
from services.numerics.kernel import inner_kernel, kernel

Floats = NDArray[np.float64]

APART_M: Final = 100.0
"""Feet closer along the axis than this are one candidate."""


class Foot(NamedTuple):
    """Where a place falls on the axis."""

    axis_m: float
    aside_m: float
    """Distance from the axis, positive to the left seen towards rising `axis_m`."""


@inner_kernel
def foot_within(
    axis_m: Floats, plane_m: Floats, east_m: float, north_m: float, first: int, last: int
) -> tuple[float, float]:
    """Place along the axis and signed distance of the foot among segments `first` to `last` (exclusive)."""
    nearest, along, aside = np.inf, axis_m[first], np.inf
    for i in range(first, last):
        step_e, step_n = plane_m[i + 1, 0] - plane_m[i, 0], plane_m[i + 1, 1] - plane_m[i, 1]
        from_e, from_n = east_m - plane_m[i, 0], north_m - plane_m[i, 1]
        square = step_e * step_e + step_n * step_n
        share = min(max((from_e * step_e + from_n * step_n) / max(square, 1e-12), 0.0), 1.0)
        gap_e, gap_n = from_e - share * step_e, from_n - share * step_n
        distance = gap_e * gap_e + gap_n * gap_n
        if distance < nearest:
            nearest = distance
            along = axis_m[i] + share * (axis_m[i + 1] - axis_m[i])
            aside = np.sqrt(distance) if step_e * from_n - step_n * from_e >= 0.0 else -np.sqrt(distance)
    return along, aside


@kernel
def _feet(axis_m: Floats, plane_m: Floats, places: Floats, start_m: float, reach_m: Floats, found: Floats) -> None:
    """Feet of places one after the other, each within its own reach of the one before."""
    last_m = start_m
    segments = axis_m.size - 1
    for k in range(places.shape[0]):
        first, last = 0, segments
        if np.isfinite(last_m):
            first = max(np.searchsorted(axis_m, last_m - reach_m[k]) - 1, 0)
            last = min(max(np.searchsorted(axis_m, last_m + reach_m[k]), first + 1), segments)
            first = min(first, last - 1)
        found[k, 0], found[k, 1] = foot_within(axis_m, plane_m, places[k, 0], places[k, 1], first, last)
        if np.isfinite(found[k, 0]):
            last_m = found[k, 0]


def follow(axis: Axis, places: Floats, reach_m: Floats, start_m: float = np.nan) -> Floats:
    """Feet (n, 2: axis_m, aside_m) of places (n, 2) one after the other.

    Each is looked for within its `reach_m` (n,) along the axis of the one before it, the first
    within that of `start_m`, or anywhere when that is NaN. Places that are NaN have no foot.
    """
    found = np.full((len(places), 2), np.nan)
    known = np.isfinite(places).all(axis=1)
    feet = np.empty((int(known.sum()), 2))
    _feet(axis.axis_m, axis.plane_m, np.array(places[known], float), start_m, np.array(reach_m, float)[known], feet)
    found[known] = feet
    return found


def candidates(axis: Axis, place: Floats, within_m: float) -> tuple[Foot, ...]:
    """Feet of a place (2,) no further than `within_m` from it, one per passage of the line, nearest first.

    >>> from services.line.axis import axis_of
    >>> loop = axis_of([0.0, 0.0, 0.0001, 0.0001], [0.0, 0.01, 0.01, 0.0], [0.0] * 4)
    >>> [round(foot.axis_m) for foot in candidates(loop, np.array([500.0, 2.0]), 30.0)]
    [500, 1737]
    """
    start, step = axis.plane_m[:-1], np.diff(axis.plane_m, axis=0)
    offset = place - start
    share = np.clip((offset * step).sum(axis=1) / np.maximum((step**2).sum(axis=1), 1e-12), 0.0, 1.0)
    gap = offset - share[:, None] * step
    distance = np.hypot(gap[:, 0], gap[:, 1])
    side = np.where(step[:, 0] * offset[:, 1] - step[:, 1] * offset[:, 0] >= 0.0, 1.0, -1.0)
    along = axis.axis_m[:-1] + share * np.diff(axis.axis_m)
    feet: list[Foot] = []
    for i in np.argsort(distance, kind="stable").tolist():
        if distance[i] > within_m:
            break
        if all(abs(along[i] - foot.axis_m) > APART_M for foot in feet):
            feet.append(Foot(float(along[i]), float(side[i] * distance[i])))
    return tuple(feet)
