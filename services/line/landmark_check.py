"""Whether the landmarks of a line file are in the order of their direction, and are what the line's curves say."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Final

import numpy as np

from schemas.line import Landmark, Line
from services.line.alignment import Alignment
from services.line.problem import Problem, error, warning

ROWS: Final = (
    "entry_straight_start_m",
    "entry_straight_end_m",
    "entry_lower_limit_m",
    "exit_lower_limit_m",
    "exit_straight_start_m",
    "exit_straight_end_m",
)
"""Rows of Iwata et al., table 1, in the order in which a train passes them."""
RADIUS_OFF_SHARE: Final = 0.2
STRAIGHT_PER_M: Final = 0.0004
"""A curvature below this is a straight."""
CROSSING_OFF_M: Final = 10.0
"""The crossing of the lower limit may be so far from where the line's own curves have it."""


def landmark_problems(line: Line, alignments: Mapping[str, Alignment]) -> Iterator[Problem]:
    """Every landmark against its route; `alignments` by branch, those that could be made."""
    if line.landmarks and not line.version:
        yield warning(
            "$.version", "empty, but the file has landmarks", "state a version: trains with another one refuse to match"
        )
    for number, landmark in enumerate(line.landmarks):
        field = f"$.landmarks[{number}]"
        known = {"", *(branch.id for branch in line.branches)}
        if landmark.branch not in known:
            named = ", ".join(sorted(known - {""})) or "none"
            yield error(f"{field}.branch", f"unknown branch {landmark.branch!r}", f"branches of this file: {named}")
        elif landmark.branch in alignments:
            found = list(_order(landmark, field)) or list(_on_line(landmark, alignments[landmark.branch], field))
            yield from found
            if not found:
                yield from _against_curves(landmark, alignments[landmark.branch], field)


def _order(landmark: Landmark, field: str) -> Iterator[Problem]:
    """Rows that run against their direction."""
    sign = 1.0 if landmark.direction == "up" else -1.0
    for before, after in pairwise(ROWS):
        if sign * (getattr(landmark, after) - getattr(landmark, before)) < 0.0:
            word = "rise" if landmark.direction == "up" else "fall"
            yield error(
                f"{field}.{after}",
                f"{getattr(landmark, after):g} after {before} {getattr(landmark, before):g}",
                f"rows of direction {landmark.direction!r} {word}: give them as the train passes them",
            )


def _on_line(landmark: Landmark, alignment: Alignment, field: str) -> Iterator[Problem]:
    """Rows beyond the end."""
    for name in ROWS:
        if getattr(landmark, name) > alignment.length_m + 1.0:
            yield error(
                f"{field}.{name}",
                f"{getattr(landmark, name):g} is beyond the end at {alignment.length_m:.0f}",
                "places are axis_m, true metres, not kilometrage",
            )


def _against_curves(landmark: Landmark, alignment: Alignment, field: str) -> Iterator[Problem]:
    """Hand, radius, straights and crossing that the line's curves do not have; nothing where it lists no curves."""
    if not alignment.curves:
        return
    sign = 1.0 if (landmark.hand == "left") == (landmark.direction == "up") else -1.0
    middle_m = (landmark.entry_lower_limit_m + landmark.exit_lower_limit_m) / 2.0
    bend = sign * float(alignment.curvature_per_m(middle_m))
    if bend <= STRAIGHT_PER_M:
        shape = "a straight" if abs(bend) <= STRAIGHT_PER_M else "a curve of the other hand"
        advice = "hand is the side towards which the train turns, seen by the train in its direction"
        yield error(f"{field}.hand", f"the line has {shape} at axis_m {middle_m:.0f}", advice)
        return
    if abs(bend * landmark.radius_m - 1.0) > RADIUS_OFF_SHARE:
        yield error(
            f"{field}.radius_m",
            f"{landmark.radius_m:g} m, where the line has a curve of {1.0 / bend:.0f} m",
            "correct the one that is wrong, or survey the landmark anew",
        )
    limit = landmark.lower_share / landmark.radius_m
    near = landmark.exit_lower_limit_m + np.arange(-CROSSING_OFF_M, CROSSING_OFF_M + 0.5, 0.5)
    above = np.abs(alignment.curvature_per_m(near)) >= limit
    if above.all() or not above.any():
        yield warning(
            f"{field}.exit_lower_limit_m",
            f"the line's curvature does not cross {limit:.5f} 1/m within {CROSSING_OFF_M:g} m",
            "survey the landmark anew, or correct the curve",
        )
    for first, last in (ROWS[:2], ROWS[4:]):
        ends = sorted((getattr(landmark, first), getattr(landmark, last)))
        inside = np.abs(alignment.curvature_per_m(np.linspace(ends[0] + 0.5, max(ends[1] - 0.5, ends[0] + 0.5), 21)))
        if float(np.median(inside)) > STRAIGHT_PER_M:
            yield warning(f"{field}.{first}", "the line is curved there", "a straight of some 20 m is diagnosed here")
