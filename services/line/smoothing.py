"""A smooth axis through vertices that are noisy or far apart: a smoothing spline of a railway's own kind.

Points on an even grid are sought that stay near the vertices and change their curvature as little as
possible: minimise Σ |p_i - f(s_i)|² + λ Σ |third difference of f|². Straights and arcs cost next to
nothing, clothoids little. λ follows from generalised cross-validation (Craven and Wahba 1979), the
variance of the direction from the inverse's band (Takahashi et al. 1973).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import kernel

Floats = NDArray[np.float64]

GRID_M: Final = 5.0
"""Points between which f is a chord: 1 cm off the arc at R 300 m."""
FEWEST_POINTS: Final = 8
"""Of a grid: third differences need four."""
WEIGHTS: Final = tuple(10.0 ** (k / 2.0) for k in range(-6, 17))
"""Values of λ that are tried: from the vertices taken as they are, to metres of noise."""
ROUNDS: Final = 3
"""How often vertices are placed anew along the smoothed axis: noise makes a polyline too long."""
CHORD_M: Final = 0.05
"""Vertices this near to a chord between others say nothing of their own: many maps are resampled polylines."""
DENSE_M: Final = 35.0
"""Vertices further apart than this are nobody's resampling, and near a chord by chance."""
LONG_EDGE_M: Final = 80.0
"""An edge this long is meant straight: whoever draws a curve puts vertices closer."""
EDGE_POINT_M: Final = 25.0
"""Points that hold such an edge straight stand this far apart, and from its ends."""
HELD_WEIGHT: Final = 0.2
"""Of these points against vertices: they are a guess, and say nothing of the vertices' noise."""


@dataclass(frozen=True, slots=True)
class SmoothAxis:
    """An axis in the plane on an even grid. Made by `smooth`."""

    along_m: Floats
    """Shape (n,): from 0 in steps of about GRID_M, true metres."""
    plane_m: Floats
    """Shape (n, 2): east, north."""
    curvature_per_m: Floats
    """Shape (n,), positive to the left."""
    heading_sigma_rad: Floats
    """Shape (n,): standard deviation of its direction, from the vertices' noise alone."""
    vertex_along_m: Floats
    """Shape (m,): where each given vertex falls."""
    points_m: Floats
    """Shape (k, 2): the vertices with points that hold long edges straight."""
    points_along_m: Floats
    """Shape (k,)."""
    noise_m: float
    """Standard deviation of the vertices across the axis, as estimated."""


@kernel
def _factor(band: Floats) -> None:
    """L D Lᵀ of a symmetric matrix in place; `band[k, j]` is element (j + k, j), then D and L's columns."""
    count, depth = band.shape[1], band.shape[0]
    for j in range(count):
        reach = min(depth, count - j)
        for k in range(1, reach):
            share = band[k, j] / band[0, j]
            for i in range(k, reach):
                band[i - k, j + k] -= share * band[i, j]
        for k in range(1, reach):
            band[k, j] /= band[0, j]


@kernel
def _solve(factors: Floats, right: Floats) -> None:
    """Solution for right sides (n, 2), in place."""
    depth, count = factors.shape
    for j in range(count):
        for k in range(1, min(depth, count - j)):
            for c in range(right.shape[1]):
                right[j + k, c] -= factors[k, j] * right[j, c]
    for j in range(count - 1, -1, -1):
        for c in range(right.shape[1]):
            right[j, c] /= factors[0, j]
        for k in range(1, min(depth, count - j)):
            for c in range(right.shape[1]):
                right[j, c] -= factors[k, j] * right[j + k, c]


@kernel
def _inverse_band(factors: Floats) -> Floats:
    """Elements of the inverse within the band, from the last row up (Takahashi et al. 1973)."""
    depth, count = factors.shape
    inverse = np.zeros((depth, count))
    for j in range(count - 1, -1, -1):
        reach = min(depth, count - j)
        for k in range(reach - 1, -1, -1):
            total = 1.0 / factors[0, j] if k == 0 else 0.0
            for i in range(1, reach):
                low, high = min(i, k), max(i, k)
                total -= factors[i, j] * inverse[high - low, j + low]
            inverse[k, j] = total
    return inverse


@kernel
def _normal(cell: NDArray[np.int64], share: Floats, weight: Floats, count: int, smoothness: float) -> Floats:
    """Band of the normal equations: every vertex a chord's point, every four grid points a third difference."""
    band = np.zeros((4, count))
    for i in range(cell.size):
        j, a, b = cell[i], 1.0 - share[i], share[i]
        band[0, j] += weight[i] * a * a
        band[0, j + 1] += weight[i] * b * b
        band[1, j] += weight[i] * a * b
    for j in range(count - 3):
        for k in range(4):
            for i in range(k, 4):
                difference = (-1.0, 3.0, -3.0, 1.0)
                band[i - k, j + k] += smoothness * difference[k] * difference[i]
    return band


class _Choice(NamedTuple):
    """Outcome for the λ that cross-validates best."""

    score: float
    fitted: Floats
    inverse: Floats
    noise_m: float


def smooth(vertices: Floats, least_noise_m: float = 0.0) -> SmoothAxis:
    """Smooth axis through vertices (m, 2) of a plane, in order; m of at least 2.

    Vertices drawn from a picture err together with their neighbours, which cross-validation takes for
    truth: `least_noise_m` is the error that they are known to have at least.
    """
    spacing_m = float(np.median(np.hypot(*np.diff(vertices, axis=0).T)))
    kept = thinned(vertices, CHORD_M) if spacing_m <= DENSE_M else np.arange(len(vertices))
    points, weight, given = _held_straight(vertices[kept])
    along = lengths_m(points)
    for _ in range(ROUNDS):
        count = max(math.ceil(along[-1] / GRID_M) + 1, FEWEST_POINTS)
        step_m = along[-1] / (count - 1)
        best = _best(points, weight, along / step_m, count, least_noise_m)
        along = _along(best.fitted, points, along / step_m)
    variance = np.maximum(_difference_variance(best.inverse), 0.0)
    grid_m = lengths_m(best.fitted)
    scale = grid_m[-1] / ((len(grid_m) - 1) * step_m)
    return SmoothAxis(
        grid_m,
        best.fitted,
        curvature_of(best.fitted),
        np.sqrt(variance) * best.noise_m / step_m,
        _between(vertices, kept, along[given] * scale),
        points,
        along * scale,
        best.noise_m,
    )


def lengths_m(points: Floats) -> Floats:
    """Length (n,) along a polyline (n, 2)."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])


def curvature_of(points: Floats) -> Floats:
    """Curvature (n,) of an evenly spaced polyline (n, 2): turn at each point over the length about it."""
    step = np.diff(points, axis=0)
    turn = np.arctan2(step[:-1, 0] * step[1:, 1] - step[:-1, 1] * step[1:, 0], (step[:-1] * step[1:]).sum(axis=1))
    length = np.hypot(*step.T)
    inner = turn / ((length[:-1] + length[1:]) / 2.0)
    return np.concatenate([inner[:1], inner, inner[-1:]])


def thinned(vertices: Floats, tolerance_m: float) -> NDArray[np.int64]:
    """Indices of the vertices, ends included, between which chords stay within a tolerance of all others.

    Ramer 1972, Douglas and Peucker 1973.
    """
    kept = {0, len(vertices) - 1}
    open_pieces = [(0, len(vertices) - 1)]
    while open_pieces:
        first, last = open_pieces.pop()
        if last - first < 2:  # noqa: PLR2004 - nothing between
            continue
        start, step = vertices[first], vertices[last] - vertices[first]
        offset = vertices[first + 1 : last] - start
        share = np.clip((offset @ step) / max(float(step @ step), 1e-12), 0.0, 1.0)
        off = np.hypot(*(offset - share[:, None] * step).T)
        if float(off.max()) > tolerance_m:
            middle = first + 1 + int(off.argmax())
            kept.add(middle)
            open_pieces += [(first, middle), (middle, last)]
    return np.array(sorted(kept), np.int64)


def _between(vertices: Floats, kept: NDArray[np.int64], kept_along_m: Floats) -> Floats:
    """Places (m,) of all vertices from those of the ones that were kept, in proportion to the polyline's length."""
    length = lengths_m(vertices)
    return np.asarray(np.interp(length, length[kept], kept_along_m))


def _held_straight(vertices: Floats) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Vertices with points on their long edges, the weight of each, and which ones are the given vertices."""
    points: list[Floats] = [vertices[0]]
    given = [0]
    for before, here in pairwise(vertices):
        long_m = float(np.hypot(*(here - before)))
        between = int(long_m / EDGE_POINT_M) - 1 if long_m >= LONG_EDGE_M else 0
        points += [before + (k + 1) / (between + 1) * (here - before) for k in range(between)]
        points.append(here)
        given.append(len(points) - 1)
    every = np.array(points)
    weight = np.full(len(every), HELD_WEIGHT)
    weight[given] = 1.0
    return every, weight, np.array(given, np.int64)


def _best(points: Floats, weight: Floats, place: Floats, count: int, least_noise_m: float) -> _Choice:
    """Fit with the λ that cross-validates best among those that leave enough noise; `place` in grid steps."""
    real = weight == 1.0
    cell = np.clip(place.astype(np.int64), 0, count - 2)
    share = place - cell
    right = np.zeros((count, 2))
    np.add.at(right, cell, (weight * (1.0 - share))[:, None] * points)
    np.add.at(right, cell + 1, (weight * share)[:, None] * points)
    best: _Choice | None = None
    for smoothness in WEIGHTS:
        band = _normal(cell, share, weight, count, smoothness)
        _factor(band)
        fitted = right.copy()
        _solve(band, fitted)
        inverse = _inverse_band(band)
        a, b = 1.0 - share, share
        own = a * a * inverse[0, cell] + b * b * inverse[0, cell + 1] + 2.0 * a * b * inverse[1, cell]
        free = max(float(real.sum()) - float(own[real].sum()), 1e-9)
        gap = points - (a[:, None] * fitted[cell] + b[:, None] * fitted[cell + 1])
        squares = float((gap[real] ** 2).sum())
        score, noise_m = squares / free**2, math.sqrt(squares / free)
        if best is None or score < best.score or best.noise_m < least_noise_m:
            best = _Choice(score, fitted, inverse, noise_m)
    if best is None:
        msg = "no smoothness to choose from"
        raise ValueError(msg)
    return best


def _along(fitted: Floats, points: Floats, place: Floats) -> Floats:
    """Where the points fall on the fitted axis, never falling, from 0: one Newton step along its direction."""
    cell = np.clip(place.astype(np.int64), 0, len(fitted) - 2)
    share = (place - cell)[:, None]
    foot = (1.0 - share) * fitted[cell] + share * fitted[cell + 1]
    step = fitted[cell + 1] - fitted[cell]
    shift_m = ((points - foot) * step).sum(axis=1) / np.maximum(np.hypot(*step.T), 1e-9)
    length = lengths_m(fitted)
    along = np.maximum.accumulate(np.interp(place, np.arange(len(fitted)), length) + shift_m)
    return np.asarray(along - along[0])


def _difference_variance(inverse: Floats) -> Floats:
    """Variance (n,) of f's first differences, relative to the noise's, per coordinate."""
    inner = inverse[0, :-1] + inverse[0, 1:] - 2.0 * inverse[1, :-1]
    return np.append(inner, inner[-1:])
