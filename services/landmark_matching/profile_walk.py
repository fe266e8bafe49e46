"""Feeds samples to a grid of places: what is common to finding a start and choosing a branch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from services.landmark_matching.curvature_grid import CurvatureGrid
from services.landmark_matching.curvature_route import Route
from services.landmark_matching.reading import Sample

STEP_M: Final = 10.0
"""Way between two corrections of the grid; a third of an ordinary window."""


class ProfileWalk:
    """Moves and weighs a grid step by step along the way."""

    def __init__(self, grid: CurvatureGrid, step_m: float = STEP_M) -> None:
        """Begin with the grid as it is; it is moved and weighed every `step_m`."""
        self.grid = grid
        self._step_m = step_m
        self._last: Sample | None = None
        self.way_m = 0.0
        """Gone since the begin."""

    def take(self, sample: Sample) -> bool:
        """Take one sample; True when the grid has changed."""
        if self._last is None:
            self._last = sample
            return False
        way_m = sample.distance_m - self._last.distance_m
        if abs(way_m) < self._step_m:
            return False
        self.grid.move(way_m, sample.excess_m - self._last.excess_m)
        if not math.isnan(sample.curvature_per_m) and sample.window_m > 0.0:
            self.grid.weigh(sample.curvature_per_m, sample.window_m, abs(way_m) / sample.window_m)
        self._last = sample
        self.way_m += abs(way_m)
        return True


def warm_up(routes: Sequence[Route]) -> None:
    """Compile the kernels, or load them from their cache, before the first sample waits for them."""
    grid = CurvatureGrid(routes)
    grid.move(1.0)
    grid.weigh(0.0, 1.0, 1.0)
