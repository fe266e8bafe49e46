"""Watches for junctions ahead: from shortly before one on, the curvature is held against every way."""

from __future__ import annotations

from typing import Final

from services.landmark_matching.anchor import Anchor
from services.landmark_matching.branch_choice import BranchChoice, Choice
from services.landmark_matching.line_landmarks import LineLandmarks
from services.landmark_matching.reading import Sample

BEFORE_M: Final = 100.0
"""The choice begins this far before the train may have reached the junction."""


class JunctionWatch:
    """For trains that meet junctions facing (direction `up`), and for those that do not know on which way they are.

    A train that comes from a known branch meets no question: its way goes on over the main line.
    """

    def __init__(self, known: LineLandmarks) -> None:
        """Begin with no junction under way."""
        self._known = known
        self._choice: BranchChoice | None = None
        self._beyond = False
        self._passed: float | None = None

    @property
    def undecided(self) -> bool:
        """Whether the train may be on one way or another."""
        return self._choice is not None and self._beyond

    def step(self, sample: Sample, anchor: Anchor | None, *, undecided: bool = False) -> Choice | None:
        """Take a sample and the place held; what the curvature says, whenever that has changed.

        `anchor` may be None while a choice is under way: it goes on by the odometry alone. `undecided`: the
        place is held, but not on which branch.
        """
        if self._choice is None:
            if anchor is not None:
                self._begin(sample, anchor, undecided=undecided)
            return None
        choice, junction_m = self._choice.take(sample), self._choice.junction_axis_m
        if anchor is not None:
            place_m = anchor.place(sample.distance_m)
            behind_m, ahead_m = anchor.window(sample.distance_m, sample.excess_m)
            self._beyond = place_m + ahead_m > junction_m or anchor.direction == "down"
            if anchor.direction == "up" and place_m + behind_m < junction_m - 2.0 * BEFORE_M - ahead_m:
                self._end(None)
                return choice
        if self._choice.done:
            self._end(junction_m)
        return choice

    def _end(self, passed_m: float | None) -> None:
        self._choice, self._beyond, self._passed = None, False, passed_m

    def _begin(self, sample: Sample, anchor: Anchor, *, undecided: bool) -> None:
        """Begin a choice where a junction is near, or where the place lies beyond one and the branch is not known."""
        place_m = anchor.place(sample.distance_m)
        behind_m, ahead_m = anchor.window(sample.distance_m, sample.excess_m)
        between = (place_m - behind_m, place_m + ahead_m)
        junctions = sorted({junction.axis_m for junction in self._known.junctions})
        if undecided:
            reached = [one for one in junctions if one <= max(abs(between[0]), abs(between[1]))]
            if reached and self._passed != reached[-1]:
                self._choose(anchor, reached, between)
            return
        if anchor.direction != "up" or anchor.branch:
            return
        for junction_m in junctions:
            if self._passed == junction_m and between[1] < junction_m - 2.0 * BEFORE_M:
                self._passed = None
            if between[1] >= junction_m - BEFORE_M and between[0] <= junction_m and self._passed != junction_m:
                self._choose(anchor, [junction_m], between)
                return

    def _choose(self, anchor: Anchor, junctions: list[float], between: tuple[float, float]) -> None:
        names = {""} | {one.branch for one in self._known.junctions if one.axis_m in junctions}
        routes = [route for route in self._known.routes_of(anchor.direction) if route.branch in names]
        self._choice = BranchChoice(routes, junctions[-1], between)
