"""Watches for junctions ahead: from shortly before one on, the curvature is held against every way."""

from __future__ import annotations

from typing import Final

from services.landmark_matching.anchor import Anchor
from services.landmark_matching.branch_choice import BranchChoice, Choice
from services.landmark_matching.line_landmarks import LineLandmarks
from services.landmark_matching.reading import Sample

BEFORE_M: Final = 100.0
"""The choice begins this far before the train may have reached the junction."""
BEYOND_M: Final = 3000.0
"""A choice that is not made by then is given up: the ways are alike."""


class JunctionWatch:
    """For trains that meet junctions facing (direction `up`); a train coming from a branch knows its way already."""

    def __init__(self, known: LineLandmarks) -> None:
        """Begin with no junction under way."""
        self._known = known
        self._choice: BranchChoice | None = None
        self._passed: float | None = None
        self._beyond = False

    @property
    def undecided(self) -> bool:
        """Whether the train may be on one way or another."""
        return self._choice is not None and self._beyond

    def step(self, sample: Sample, anchor: Anchor | None) -> Choice | None:
        """Take a sample and the place held; what the curvature says, whenever that has changed.

        `anchor` may be None while a choice is under way: it goes on by the odometry alone.
        """
        if self._choice is None:
            if anchor is not None:
                self._begin(sample, anchor)
            return None
        choice = self._choice.take(sample)
        if anchor is not None:
            place_m = anchor.place(sample.distance_m)
            self._beyond = place_m + anchor.window(sample.distance_m, sample.excess_m)[1] > self._choice.junction_axis_m
            gone = place_m > self._choice.junction_axis_m + BEYOND_M
            back = place_m < self._choice.junction_axis_m - 2.0 * BEFORE_M - anchor.ahead_m
            if (gone or back or anchor.direction != "up") and not self._choice.done:
                self._end(self._choice.junction_axis_m if gone else None)
                return choice
        if self._choice.done:
            self._end(self._choice.junction_axis_m)
        return choice

    def _end(self, passed_m: float | None) -> None:
        self._choice, self._beyond, self._passed = None, False, passed_m

    def _begin(self, sample: Sample, anchor: Anchor) -> None:
        if anchor.direction != "up" or anchor.branch:
            return
        place_m = anchor.place(sample.distance_m)
        behind_m, ahead_m = anchor.window(sample.distance_m, sample.excess_m)
        for junction_m in sorted({junction.axis_m for junction in self._known.junctions}):
            if place_m + ahead_m < junction_m - 2.0 * BEFORE_M and self._passed == junction_m:
                self._passed = None
            near = place_m + ahead_m >= junction_m - BEFORE_M and place_m - behind_m <= junction_m
            if near and self._passed != junction_m:
                names = {""} | {one.branch for one in self._known.junctions if one.axis_m == junction_m}
                routes = [route for route in self._known.routes_of("up") if route.branch in names]
                self._choice = BranchChoice(routes, junction_m, (place_m - behind_m, place_m + ahead_m))
                return
