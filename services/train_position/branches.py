"""On which routes the train can be, by what was heard of switches and curves; and the stretch that it occupies.

A route is the main line, or the main line up to a junction and then a branch, named by the branch; places
count through, so that one interval of `axis_m` serves all routes. A route comes back into question once
the whole train is on the near side of its junction: the switch can lie differently then.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal

from schemas.position import Stretch
from services.train_position.claims import Interval

MAIN: Final = ""
Evidence = Literal["route", "curvature", "reference", "satellites"]


class Branches:
    """Routes that are possible."""

    def __init__(self, leaves_m: Mapping[str, float]) -> None:
        """Know where branches leave; every route is possible."""
        self._leaves_m = dict(leaves_m)
        self.possible: set[str] = {MAIN, *leaves_m}
        self.route: str | None = None
        """Route that is set, as the train's equipment or a person says."""
        self.disputed = ""
        """Why more routes are possible than one source says; empty when none is disputed."""
        self._parties: set[Evidence] = {"route"}
        """Sources that take part in the dispute."""

    def knows(self, branch: str) -> bool:
        """Whether there is such a branch."""
        return branch == MAIN or branch in self._leaves_m

    def passed(self, span: Interval) -> None:
        """Let routes come back whose junction lies wholly beyond the train."""
        on_main = any(span.greatest_m < self._leaves_m.get(one, float("inf")) for one in self.possible)
        back = {one for one, leaves_m in self._leaves_m.items() if leaves_m > span.greatest_m}
        if not on_main or not back:
            return
        if not back <= self.possible or MAIN not in self.possible:
            self.possible |= back | {MAIN}
            self.disputed = ""

    def set_route(self, branch: str, span: Interval | None) -> None:
        """A route was set; it counts for junctions that the train has not reached yet."""
        self.route = branch
        if span is not None:
            self.passed(span)

    def candidates(self, span: Interval) -> set[str]:
        """Possible routes, less those that the route set excludes ahead of the train."""
        if self.route is None or self.route not in self.possible:
            return self.possible
        ahead = {one for one, leaves_m in self._leaves_m.items() if leaves_m > span.least_m and one != self.route}
        left = self.possible - ahead
        if self.route != MAIN and self._leaves_m[self.route] > span.least_m:
            left.discard(MAIN)
        return left or {self.route}

    def commit(self, span: Interval) -> None:
        """Keep what the route set decided, as the train passes the junction."""
        if self.route is None:
            return
        reached = [leaves_m for leaves_m in self._leaves_m.values() if span.least_m <= leaves_m <= span.greatest_m]
        if reached:
            self.possible = set(self.candidates(span))

    def decide(self, branch: str, junction_m: float | None, by: Evidence) -> str:
        """Take evidence for a branch at a junction; returns what it contradicts, or nothing.

        Evidence for the main line excludes the branches that leave at that junction.
        """
        if branch == MAIN:
            gone = {
                one
                for one, leaves_m in self._leaves_m.items()
                if junction_m is None or abs(leaves_m - junction_m) < 1.0
            }
            left = self.possible - gone
        else:
            left = self.possible & {branch}
        if self.disputed and by in self._parties:
            return ""
        if left:
            self.possible = left
            self.disputed, self._parties = "", {"route", by}
            return ""
        said = ", ".join(sorted(one or "the main line" for one in self.possible))
        self.possible |= {branch}
        self._parties.add(by)
        self.disputed = f"{by} says {branch or 'the main line'}, against {said}"
        return self.disputed

    def exclude(self, branch: str) -> bool:
        """Take evidence against a route; returns whether it changed anything. The last one is never excluded."""
        if branch in self.possible and len(self.possible) > 1:
            self.possible.discard(branch)
            return True
        return False

    def at(self, route: str, axis_m: float) -> str:
        """Branch on which a place of a route is."""
        return route if route and axis_m >= self._leaves_m[route] else MAIN

    def of(self, places: Interval, span: Interval) -> str | None:
        """Branch of all of some places; None while it is undecided."""
        found = {
            self.at(route, place_m)
            for route in self.candidates(span)
            for place_m in (places.least_m, places.greatest_m)
        }
        return found.pop() if len(found) == 1 else None

    def occupied(self, span: Interval) -> tuple[Stretch, ...]:
        """Every stretch that the train may stand on, on every route possible."""
        stretches: dict[str, Interval] = {}
        for route in sorted(self.candidates(span)):
            leaves_m = self._leaves_m.get(route, float("inf"))
            parts = [(MAIN, Interval(span.least_m, min(span.greatest_m, leaves_m)))]
            if route:
                parts.append((route, Interval(max(span.least_m, leaves_m), span.greatest_m)))
            for branch, part in parts:
                if part.width_m > 0.0 or (part.width_m == 0.0 and span.width_m == 0.0):
                    stretches[branch] = stretches[branch].hull(part) if branch in stretches else part
        return tuple(
            Stretch(branch=branch, start_axis_m=part.least_m, end_axis_m=part.greatest_m)
            for branch, part in stretches.items()
        )
