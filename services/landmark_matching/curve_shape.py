"""A curve as the train meets it: where it begins and ends, and the mean curvature that a window over it measures.

Places are `u_m`, rising in the direction of running: `axis_m` for `up`, minus `axis_m` for `down`.
Curvature is positive to the train's left. Transitions are clothoids: curvature rises linearly.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schemas.line import Curve, Direction, Landmark

Floats = NDArray[np.float64]

GRID_M: Final = 0.5
"""Step of the grid on which crossings are looked for; between two places the crossing is interpolated."""
SHORTEST_WINDOW_M: Final = 0.1


class ShapeError(ValueError):
    """Rows of a landmark that make no curve."""


@dataclass(frozen=True, slots=True)
class CurveShape:
    """Transition, arc, transition, in the direction of running."""

    start_m: float
    arc_start_m: float
    arc_end_m: float
    end_m: float
    curvature_per_m: float
    """Of the arc, signed."""


@dataclass(frozen=True, slots=True)
class Crossing:
    """Where a measured curvature crosses a level."""

    u_m: float
    slope_per_m2: float
    """Change of curvature per metre there, as a size."""


def direction_sign(direction: Direction) -> float:
    """+1 where `axis_m` rises in the direction of running, else -1."""
    return 1.0 if direction == "up" else -1.0


def shape_of_landmark(landmark: Landmark) -> CurveShape:
    """Shape that the rows of a landmark imply (Iwata et al., table 1).

    The lower limit stands `lower_share` up the transition, so the whole transition is longer by 1/lower_share.
    Raises ShapeError where the rows are out of order or leave no arc.

    >>> rows = dict(entry_straight_start_m=827.0, entry_straight_end_m=847.0, entry_lower_limit_m=881.0)
    >>> rows |= dict(exit_lower_limit_m=953.0, exit_straight_start_m=987.0, exit_straight_end_m=1007.0)
    >>> shape = shape_of_landmark(Landmark(id="L1", direction="up", hand="left", radius_m=300.0, **rows))
    >>> shape.arc_start_m, shape.arc_end_m
    (889.5, 944.5)
    """
    sign = direction_sign(landmark.direction)
    places = [
        sign * place
        for place in (
            landmark.entry_straight_start_m,
            landmark.entry_straight_end_m,
            landmark.entry_lower_limit_m,
            landmark.exit_lower_limit_m,
            landmark.exit_straight_start_m,
            landmark.exit_straight_end_m,
        )
    ]
    if any(after < before for before, after in pairwise(places)) or places[2] == places[3]:
        msg = f"landmark {landmark.id}: its places are not in the order in which a train going {landmark.direction}"
        msg += " passes them"
        raise ShapeError(msg)
    _, start, entry, leaving, end, _ = places
    arc_start = start + (entry - start) / landmark.lower_share
    arc_end = end - (end - leaving) / landmark.lower_share
    if arc_end < arc_start:
        msg = f"landmark {landmark.id}: its transitions leave no arc between them"
        raise ShapeError(msg)
    hand = 1.0 if landmark.hand == "left" else -1.0
    return CurveShape(start, arc_start, arc_end, end, hand / landmark.radius_m)


def shape_of_curve(curve: Curve, direction: Direction) -> CurveShape:
    """Shape of a curve of the line file, as a train in `direction` meets it."""
    curvature = 1.0 / curve.radius_m
    start, end = curve.start_axis_m, curve.end_axis_m
    inside = min(start + curve.transition_in_m, end), max(end - curve.transition_out_m, start)
    if direction == "up":
        return CurveShape(start, inside[0], inside[1], end, curvature)
    return CurveShape(-end, -inside[1], -inside[0], -start, -curvature)


def _ramp(u_m: ArrayLike, start_m: float, end_m: float) -> Floats:
    """Integral of a ramp that rises from 0 to 1 between two places."""
    inside = np.maximum(np.asarray(u_m, float) - start_m, 0.0)
    length_m = end_m - start_m
    if length_m <= 0.0:
        return inside
    climbing = np.minimum(inside, length_m)
    return np.asarray(0.5 * climbing * climbing / length_m + (inside - climbing))


def angle_rad(shape: CurveShape, u_m: ArrayLike) -> Floats:
    """How far the track has turned at places u_m, from the straight before the curve."""
    rising = _ramp(u_m, shape.start_m, shape.arc_start_m)
    return shape.curvature_per_m * (rising - _ramp(u_m, shape.arc_end_m, shape.end_m))


def mean_curvature(shape: CurveShape, u_m: ArrayLike, window_m: ArrayLike) -> Floats:
    """Curvature averaged over `window_m` about places u_m: what yaw rate over speed, both averaged, measures."""
    middle = np.asarray(u_m, float)
    window = np.maximum(np.asarray(window_m, float), SHORTEST_WINDOW_M)
    return np.asarray((angle_rad(shape, middle + 0.5 * window) - angle_rad(shape, middle - 0.5 * window)) / window)


def crossings(
    shape: CurveShape, level_per_m: float, window_m: tuple[float, float], scale: float = 1.0
) -> tuple[Crossing, Crossing] | None:
    """Where the size of the averaged curvature, times `scale`, rises above a level and falls below it again.

    `window_m` holds the windows at the entry and at the exit. None where the average does not reach the level:
    the arc is too short for this window.
    """
    found = []
    for rising, window in zip((True, False), window_m, strict=True):
        reach = 0.5 * window + GRID_M
        u = np.arange(shape.start_m - reach, shape.end_m + reach + GRID_M, GRID_M)
        size = scale * np.abs(mean_curvature(shape, u, window))
        above = size >= level_per_m
        edges = np.flatnonzero(above[1:] > above[:-1] if rising else above[1:] < above[:-1])
        if not len(edges):
            return None
        k = int(edges[0] if rising else edges[-1])
        slope = float(abs(size[k + 1] - size[k])) / GRID_M
        place = float(u[k]) + GRID_M * float((level_per_m - size[k]) / (size[k + 1] - size[k]))
        found.append(Crossing(place, slope))
    return found[0], found[1]
