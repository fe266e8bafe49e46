"""Curves of a smoothed axis: where its curvature stands out, as a first guess for `curve_fitting`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.line.smoothing import SmoothAxis

Floats = NDArray[np.float64]

FLATTEST_PER_M: Final = 1.0 / 4000.0
"""Flatter curves are left as straights: they turn a train by less than its sensors can tell."""
AVERAGE_M: Final = 60.0
"""Curvature is averaged over this to look for curves; single points of it are too noisy."""
STANDS_OUT: Final = 4.0
"""A curve's peak is at least this many standard deviations of the curvature above 0."""
EDGE_SHARE: Final = 0.3
"""A curve reaches as far as its curvature is above this share of its peak (or of FLATTEST_PER_M)."""
SADDLE_SHARE: Final = 0.6
"""Two peaks of one hand are two curves when curvature between them falls below this share of the lower one."""
LEAST_TURN_RAD: Final = 0.015
"""Curves that turn the train by less are not told from a wobble of the vertices."""
TRANSITION_M: Final = 50.0
"""First guess of a transition's length."""
SHORTEST_ARC_M: Final = 5.0


@dataclass(frozen=True, slots=True)
class Bend:
    """A curve as a trapezoid of curvature over length."""

    start_m: float
    end_m: float
    transition_in_m: float
    transition_out_m: float
    curvature_per_m: float
    """Of the arc, positive to the left."""


def bends_of(axis: SmoothAxis) -> tuple[Bend, ...]:
    """Curves in order along the axis."""
    found: list[Bend] = []
    for first, last in _runs(axis):
        guess = _guess(axis, first, last)
        if guess is not None:
            found.append(guess)
    return tuple(found)


def _runs(axis: SmoothAxis) -> list[tuple[int, int]]:
    """Grid points (first, last exclusive) of every stretch of one hand that stands out, divided at saddles."""
    bend, sigma = _averaged(axis)
    hand = np.sign(bend).astype(int)
    edges = np.flatnonzero(np.diff(hand)) + 1
    runs: list[tuple[int, int]] = []
    for first, last in zip([0, *edges], [*edges, len(bend)], strict=True):
        size = np.abs(bend[first:last])
        clear = np.maximum(FLATTEST_PER_M, STANDS_OUT * sigma[first:last])
        if (size > clear).any():
            runs += [(first + a, first + b) for a, b in _split(size, float(clear[int(size.argmax())]))]
    return runs


def _averaged(axis: SmoothAxis) -> tuple[Floats, Floats]:
    """Curvature (n,) as the change of direction over AVERAGE_M about each place, and its standard deviation."""
    step_m = np.diff(axis.along_m)
    heading = np.concatenate([[0.0], np.cumsum((axis.curvature_per_m[1:] + axis.curvature_per_m[:-1]) / 2.0 * step_m)])
    first_m = np.maximum(axis.along_m - AVERAGE_M / 2.0, 0.0)
    last_m = np.minimum(axis.along_m + AVERAGE_M / 2.0, axis.along_m[-1])
    ends = [np.interp(places, axis.along_m, heading) for places in (first_m, last_m)]
    return (ends[1] - ends[0]) / (last_m - first_m), math.sqrt(2.0) * axis.heading_sigma_rad / (last_m - first_m)


def _split(size: Floats, clear: float) -> list[tuple[int, int]]:
    """Parts of one hand: cut at the lowest point between peaks that stand out from it."""
    if len(size) < 3:  # noqa: PLR2004 - a saddle has two sides
        return [(0, len(size))] if size.max() > clear else []
    left, right = np.maximum.accumulate(size), np.maximum.accumulate(size[::-1])[::-1]
    lower_peak = np.minimum(left, right)
    depth = np.where(lower_peak > clear, size / np.maximum(lower_peak, 1e-12), 1.0)
    cut = int(depth.argmin())
    if depth[cut] >= SADDLE_SHARE:
        return [(0, len(size))] if size.max() > clear else []
    return _split(size[:cut], clear) + [(cut + a, cut + b) for a, b in _split(size[cut:], clear)]


def _guess(axis: SmoothAxis, first: int, last: int) -> Bend | None:
    """A trapezoid with the turn, the centre and about the height of what stands out."""
    bend = axis.curvature_per_m[first:last]
    peak = float(np.quantile(np.abs(bend), 0.9))
    inside = np.flatnonzero(np.abs(bend) >= max(EDGE_SHARE * peak, min(FLATTEST_PER_M, peak) / 2.0))
    if not len(inside):
        return None
    first, last = first + int(inside[0]), first + int(inside[-1]) + 1
    along, bend = axis.along_m[first:last], axis.curvature_per_m[first:last]
    step_m = float(axis.along_m[-1]) / (len(axis.along_m) - 1)
    turn = float(bend.sum()) * step_m
    if abs(turn) < LEAST_TURN_RAD:
        return None
    height = float(np.median(bend[np.abs(bend) >= np.quantile(np.abs(bend), 0.5)]))
    centre_m = float((along * bend).sum() / bend.sum())
    transition_m = min(TRANSITION_M, 0.8 * abs(turn / height))
    long_m = max(turn / height + transition_m, 2.0 * transition_m + SHORTEST_ARC_M)
    height = turn / (long_m - transition_m)
    return Bend(centre_m - long_m / 2.0, centre_m + long_m / 2.0, transition_m, transition_m, height)
