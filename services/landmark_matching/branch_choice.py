"""Which way a train took at a junction, by the curvature it met since.

The probability of each route is that of the grid filter (services/landmark_matching/curvature_grid.py), begun
before the junction with the position's margin. Its place is good to some ten metres only, so it
serves to choose the branch, never to correct the position.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from services.landmark_matching.curvature_grid import CurvatureGrid
from services.landmark_matching.curvature_route import Route
from services.landmark_matching.profile_walk import ProfileWalk
from services.landmark_matching.reading import Sample

CERTAIN: Final = 0.9999
"""Probability at which a branch counts as decided; the wrong one then has less than 1e-4."""
BEYOND_M: Final = 3000.0
"""A choice that is not made by then is given up: the ways are alike."""
LEAST_WAY_M: Final = 60.0
"""Way that must have been gone with the routes apart, however certain the curvature seems."""


@dataclass(frozen=True, slots=True)
class Choice:
    """What the curvature says so far."""

    junction_axis_m: float
    chances: tuple[tuple[str, float], ...]
    """Branch and probability."""
    decided: str | None
    reason: str


class BranchChoice:
    """One junction under way."""

    def __init__(self, routes: Sequence[Route], junction_axis_m: float, window_u_m: tuple[float, float]) -> None:
        """Routes of one direction; the train lies between the ends of the window on whichever it takes."""
        self.junction_axis_m = junction_axis_m
        grid = CurvatureGrid(routes)
        grid.expect([window_u_m] * len(routes))
        self._walk = ProfileWalk(grid)
        facing = routes[0].direction == "up"
        self._until_m = max(0.0, junction_axis_m - window_u_m[0]) if facing else 0.0
        self.done = False

    def take(self, sample: Sample) -> Choice | None:
        """Take one sample; the choice so far when it has changed. Nothing more once it is decided."""
        if self.done or not self._walk.take(sample):
            return None
        grid = self._walk.grid
        if grid.lost:
            self.done = True
            return None
        chances = tuple(zip((route.branch for route in grid.routes), grid.route_chances(), strict=True))
        branch, best = max(chances, key=lambda one: one[1])
        apart_m = self._walk.way_m - self._until_m
        decided = branch if best >= CERTAIN and apart_m >= LEAST_WAY_M else None
        self.done = decided is not None or apart_m > BEYOND_M
        name = branch or "the main line"
        reason = f"curvature of {self._walk.way_m:.0f} m fits {name} with {100.0 * best:.2f} %"
        return Choice(self.junction_axis_m, chances, decided, reason)
