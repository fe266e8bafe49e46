"""Where a run began, found from nothing but its curvature: every place of every route and direction is tried."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from schemas.line import Direction
from services.landmark_matching.curvature_grid import CurvatureGrid
from services.landmark_matching.curvature_route import Route
from services.landmark_matching.profile_walk import ProfileWalk
from services.landmark_matching.reading import Sample

NEAR_M: Final = 60.0
"""Places within this distance of the best count as the same."""
CERTAIN: Final = 0.999
ELSEWHERE: Final = 0.5
"""Probability, before anything is measured, that the run is on another line."""
STEP_M: Final = 20.0
"""Way between two corrections: every place of a whole line is weighed each time."""
LEAST_WAY_M: Final = 500.0
"""Shorter runs are not placed, however well a curve fits."""


@dataclass(frozen=True, slots=True)
class Found:
    """A place at one distance of the run."""

    branch: str
    """Empty also where the way to a branch is still the main line's."""
    direction: Direction
    u_m: float
    distance_m: float
    probability: float
    """Of lying within NEAR_M of it."""


def find_place(routes: Sequence[Route], samples: Iterable[Sample]) -> Found:
    """The place where the curvature is first certain, or the best guess at the end of the run, with its probability.

    Raises ValueError without a single sample.
    """
    walk = ProfileWalk(CurvatureGrid(routes, elsewhere=ELSEWHERE), STEP_M)
    newest = None
    for sample in samples:
        newest = sample
        if not walk.take(sample) or walk.grid.lost or walk.way_m < LEAST_WAY_M:
            continue
        found = _best(walk.grid, sample.distance_m)
        if found.probability >= CERTAIN:
            return found
    if newest is None:
        msg = "the run has no samples"
        raise ValueError(msg)
    found = _best(walk.grid, newest.distance_m)
    return replace(found, probability=0.0) if walk.grid.lost or walk.way_m < LEAST_WAY_M else found


def _best(grid: CurvatureGrid, distance_m: float) -> Found:
    """The likeliest place; ways that are still the same one there count together."""
    top, u_m = grid.best()
    direction, axis_m = grid.routes[top].direction, abs(u_m)
    probability, place_m = grid.near(top, u_m, NEAR_M)
    shared = axis_m + NEAR_M <= grid.routes[top].junction_axis_m
    branch = grid.routes[top].branch
    for number, route in enumerate(grid.routes):
        both = min(route.junction_axis_m, grid.routes[top].junction_axis_m)
        if number != top and route.direction == direction and axis_m + NEAR_M <= both:
            probability += grid.near(number, u_m, NEAR_M)[0]
    return Found("" if shared else branch, direction, place_m, distance_m, probability)
