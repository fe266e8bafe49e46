"""Where a run began, found from nothing but its curvature: every place of every route and direction is tried."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from services.landmark_matching.curvature_grid import CurvatureGrid
from services.landmark_matching.curvature_route import Route
from services.landmark_matching.profile_walk import ProfileWalk
from services.landmark_matching.reading import Sample

NEAR_M: Final = 60.0
"""Places within this distance of the best count as the same."""
CERTAIN: Final = 0.999
LEAST_WAY_M: Final = 500.0
"""Shorter runs are not placed, however well a curve fits."""


@dataclass(frozen=True, slots=True)
class Found:
    """A place at one distance of the run."""

    route: Route
    u_m: float
    distance_m: float
    probability: float
    """Of lying within NEAR_M of it."""


def find_place(routes: Sequence[Route], samples: Iterable[Sample]) -> Found:
    """The place where the curvature is first certain, or the best guess at the end of the run, with its probability.

    Raises ValueError without a single sample.
    """
    walk = ProfileWalk(CurvatureGrid(routes))
    newest = None
    for sample in samples:
        newest = sample
        if not walk.take(sample) or walk.grid.lost or walk.way_m < LEAST_WAY_M:
            continue
        route, u_m, probability = walk.grid.best(NEAR_M)
        if probability >= CERTAIN:
            return Found(routes[route], u_m, sample.distance_m, probability)
    if newest is None:
        msg = "the run has no samples"
        raise ValueError(msg)
    if walk.grid.lost:
        return Found(routes[0], routes[0].first_u_m, newest.distance_m, 0.0)
    route, u_m, probability = walk.grid.best(NEAR_M)
    return Found(routes[route], u_m, newest.distance_m, probability)
