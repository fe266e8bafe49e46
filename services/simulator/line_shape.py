"""The shape of a line: straights, transitions and arcs, as a point and a direction at every metre.

The plane is tangent to the ellipsoid at the line's origin, x east and y north [m]. Curvature is
positive to the left seen towards rising `axis_m`, and linear in `axis_m` within each piece
(a clothoid), so heading is quadratic and position is its integral. `axis_m` is true length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
MAX_TURN_RAD = 1.6
"""Largest turn within one piece: 12 Gauss-Legendre nodes integrate cos and sin of it to below 1e-9 m per km."""


class LineShapeError(ValueError):
    """Elements that make no line."""


class Element(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A straight, or a curve with equal transitions at both ends."""

    length_m: Annotated[float, Meta(gt=0.0)]
    """Transitions included."""
    radius_m: float | None = None
    """Positive to the left; None for a straight."""
    transition_m: Annotated[float, Meta(ge=0.0)] = 0.0
    """Length of each of the two clothoids."""


@dataclass(frozen=True, slots=True)
class AxisPoints:
    """Where the axis is at some `axis_m`, and where it goes. Every column has the shape asked for."""

    x_m: Floats
    y_m: Floats
    heading_rad: Floats
    """Anticlockwise from east."""
    curvature_per_m: Floats


class LineShape:
    """The axis of a line."""

    def __init__(self, elements: Sequence[Element], heading_rad: float) -> None:
        """Lay the elements one after another from (0, 0), starting with `heading_rad` from east.

        Raises LineShapeError for an element without length, a radius of zero, or transitions
        that do not fit into their element.
        """
        pieces = [piece for element in elements for piece in _pieces(element)]
        if not pieces:
            msg = "a line needs at least one element"
            raise LineShapeError(msg)
        lengths, starts, ends = (np.array(column, dtype=np.float64) for column in zip(*pieces, strict=True))
        turns = (starts + ends) / 2 * lengths
        if np.abs(turns).max() > MAX_TURN_RAD:
            msg = f"a curve turns by more than {MAX_TURN_RAD} rad at once; divide it"
            raise LineShapeError(msg)
        self._start_m = np.concatenate([[0.0], np.cumsum(lengths)])
        self._curvature = starts
        self._slope = (ends - starts) / lengths
        self._heading = heading_rad + np.concatenate([[0.0], np.cumsum(turns)])
        self._xy = np.zeros((len(pieces) + 1, 2))
        for i in range(len(pieces)):
            self._xy[i + 1] = self._within(np.array([i]), lengths[i : i + 1])[:2, 0]

    @property
    def length_m(self) -> float:
        """Length of the axis."""
        return float(self._start_m[-1])

    def at(self, axis_m: Floats | float) -> AxisPoints:
        """Points of the axis; before its start and beyond its end it goes straight on."""
        wanted = np.atleast_1d(np.asarray(axis_m, dtype=np.float64))
        inside = np.clip(wanted, 0.0, self.length_m)
        piece = np.clip(np.searchsorted(self._start_m, inside, side="right") - 1, 0, len(self._curvature) - 1)
        x, y, heading, curvature = self._within(piece, inside - self._start_m[piece])
        beyond = wanted - inside
        return AxisPoints(x + beyond * np.cos(heading), y + beyond * np.sin(heading), heading, curvature)

    def _within(self, piece: NDArray[np.int64], along_m: Floats) -> Floats:
        """Rows x, y, heading, curvature at `along_m` from the start of each piece."""
        curvature, slope, heading = self._curvature[piece], self._slope[piece], self._heading[piece]
        steps = along_m[:, None] * (1 + _NODES) / 2
        angle = heading[:, None] + curvature[:, None] * steps + slope[:, None] * steps**2 / 2
        x = self._xy[piece, 0] + along_m / 2 * (np.cos(angle) @ _WEIGHTS)
        y = self._xy[piece, 1] + along_m / 2 * (np.sin(angle) @ _WEIGHTS)
        turned = heading + curvature * along_m + slope * along_m**2 / 2
        return np.stack([x, y, turned, curvature + slope * along_m])


def _pieces(element: Element) -> list[tuple[float, float, float]]:
    """Length and curvature at start and end of each part with linear curvature."""
    if element.length_m <= 0:
        msg = f"an element of {element.length_m} m has no length"
        raise LineShapeError(msg)
    if element.radius_m is None:
        return [(element.length_m, 0.0, 0.0)]
    arc_m = element.length_m - 2 * element.transition_m
    if element.radius_m == 0 or element.transition_m < 0 or arc_m < 0:
        sizes = f"radius {element.radius_m} m with transitions of {element.transition_m} m in {element.length_m} m"
        msg = f"{sizes}: no such curve"
        raise LineShapeError(msg)
    bend = 1 / element.radius_m
    pieces = [(element.transition_m, 0.0, bend), (arc_m, bend, bend), (element.transition_m, bend, 0.0)]
    return [piece for piece in pieces if piece[0] > 0]
