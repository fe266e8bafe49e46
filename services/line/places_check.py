"""Whether everything that a line file places along a line lies on it, in order, and has a name of its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, Final

import msgspec

from schemas.line import Branch, Line
from services.line.problem import Problem, error, warning

POINTS: Final = ("gradients", "stations", "radio_sites", "balises", "chainage")
STRETCHES: Final = ("curves", "speed_limits", "surroundings", "track_circuits", "parallel_tracks")
NAMED: Final = ("stations", "radio_sites", "track_circuits", "balises", "parallel_tracks", "branches", "landmarks")
SLACK_M: Final = 1.0
"""Lengths are rounded, and the last place is often the end itself."""


def place_problems(source: Line | Branch, first_m: float, last_m: float, path: str) -> Iterator[Problem]:
    """Everything in the lists of the main line, or of a branch, which runs from `first_m` to `last_m`."""
    for name in (*POINTS, *STRETCHES):
        for number, one in enumerate(getattr(source, name, ())):
            yield from _outside(one, first_m, last_m, f"{path}.{name}[{number}]", lies_before=name == "gradients")
    yield from _order(source.stations, f"{path}.stations")
    for name in NAMED:
        yield from _twice(getattr(source, name, ()), f"{path}.{name}")
    circuits = sorted(getattr(source, "track_circuits", ()), key=lambda one: one.start_axis_m)
    for before, after in pairwise(circuits):
        if after.start_axis_m < before.end_axis_m - SLACK_M:
            yield warning(
                f"{path}.track_circuits",
                f"{before.id} and {after.id} overlap by {before.end_axis_m - after.start_axis_m:.0f} m",
                "let each circuit begin where the one before ends",
            )


def _outside(one: msgspec.Struct, first_m: float, last_m: float, field: str, *, lies_before: bool) -> Iterator[Problem]:
    """Places off the line, and stretches without a length."""
    ends = f"the line runs from {first_m:.0f} to {last_m:.0f}"
    for name in ("axis_m", "start_axis_m", "end_axis_m"):
        place_m = getattr(one, name, None)
        if place_m is None or (lies_before and place_m < first_m):
            continue
        if not first_m - SLACK_M <= place_m <= last_m + SLACK_M:
            yield error(
                f"{field}.{name}",
                f"{place_m:g} is not on it: {ends}",
                "places are axis_m, true metres, not kilometrage",
            )
    start_m, end_m = getattr(one, "start_axis_m", None), getattr(one, "end_axis_m", None)
    if start_m is not None and end_m is not None and end_m <= start_m and not hasattr(one, "radius_m"):
        yield error(
            f"{field}.end_axis_m", f"{end_m:g} is not beyond its start at {start_m:g}", "exchange start and end"
        )


def _order(stations: Sequence[Any], field: str) -> Iterator[Problem]:
    """Stations that are not in order along the line."""
    for number, (before, after) in enumerate(pairwise(stations), 1):
        if after.axis_m < before.axis_m:
            yield error(
                f"{field}[{number}].axis_m",
                f"station {after.id} at {after.axis_m:g} comes after {before.id} at {before.axis_m:g}",
                "put the stations in order along the axis",
            )


def _twice(named: Sequence[Any], field: str) -> Iterator[Problem]:
    """Ids that are given twice."""
    seen: dict[str, int] = {}
    for number, one in enumerate(named):
        if one.id in seen:
            yield error(
                f"{field}[{number}].id",
                f"{one.id!r} is that of {field}[{seen[one.id]}] too",
                "give each an id of its own",
            )
        seen.setdefault(one.id, number)
