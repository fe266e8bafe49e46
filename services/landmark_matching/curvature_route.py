"""Where the track turns along a route, on a 1 m grid, as a train of one direction feels it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.line import Direction
from services.line.alignment import Alignment

Floats = NDArray[np.float64]

STEP_M: Final = 1.0


@dataclass(frozen=True, slots=True)
class Route:
    """Heading along a route; places are `u_m`, rising in the direction of running."""

    branch: str
    direction: Direction
    first_u_m: float
    heading_rad: Floats
    """Shape (n,), every STEP_M from `first_u_m`: integral of the curvature that the train feels."""
    junction_axis_m: float = float("inf")
    """Up to here the way is the main line's; infinite on the main line itself."""

    @property
    def last_u_m(self) -> float:
        """Its last place."""
        return self.first_u_m + STEP_M * (len(self.heading_rad) - 1)


def route_of(alignment: Alignment, direction: Direction) -> Route:
    """One direction of a route.

    The curvature is the alignment's; its integral is taken by the trapezoidal rule, exact for clothoids but for
    the steps in which a transition begins or ends.
    """
    junction_m = float("inf") if alignment.junction_axis_m is None else alignment.junction_axis_m
    places = np.arange(0.0, alignment.length_m + STEP_M, STEP_M)
    curvature = alignment.curvature_per_m(np.minimum(places, alignment.length_m))
    if direction == "down":
        places, curvature = -places[::-1], -curvature[::-1]
    heading = np.concatenate([[0.0], np.cumsum(0.5 * STEP_M * (curvature[1:] + curvature[:-1]))])
    return Route(alignment.branch, direction, float(places[0]), np.ascontiguousarray(heading), junction_m)
