"""Everything that is wrong with a line file, all at once."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import date
from typing import Final

import numpy as np

from schemas.line import Branch, Line
from services.line.alignment import Alignment, alignment_of
from services.line.axis import Axis, AxisError
from services.line.chainage import ChainageError
from services.line.geometry_check import axis_problems, curve_problems, gradient_problems
from services.line.landmark_check import landmark_problems
from services.line.places_check import place_problems
from services.line.problem import Problem, error, warning
from services.line.route import axis_through, branch_chainage, junction_fault, main_chainage, turn_at_junction_rad

GAP_M: Final = 1.0
WIDEST_GAP_M: Final = 20.0
"""A branch whose axis begins further from the main line is that of another place."""
DIVERGES_RAD: Final = 0.6
"""Turnouts diverge by less than this."""
SCALE_OFF: Final = 0.05
"""Kilometrage runs no more than so much faster or slower than true metres."""
LARGEST_JUMP_M: Final = 5_000.0


def problems_of(line: Line) -> tuple[Problem, ...]:
    """All problems, errors first, each list in the order of the file."""
    found = list(_problems(line))
    return tuple(sorted(found, key=lambda one: one.severity != "error"))


def _problems(line: Line) -> Iterator[Problem]:
    yield from _days(line)
    try:
        main = axis_through(line.axis)
    except AxisError as wrong:
        yield error(f"$.axis[{wrong.vertex}]", wrong.text, "correct or leave out the vertex; nothing else was checked")
        return
    chained = True
    try:
        main_chainage(line, main)
    except ChainageError as wrong:
        advice = "rows in rising order of axis_m, at most two at one place (a broken chain), none at the line's ends"
        yield error(f"$.chainage[{wrong.place}]", wrong.text, advice)
        chained = False
    alignments: dict[str, Alignment] = {}
    if chained:
        alignments[""] = alignment_of(line)
        yield from _of_route(line, alignments[""], 0.0, "$")
        yield from _scales(line, "$")
    else:
        yield from place_problems(line, 0.0, main.length_m, "$")
    for number, branch in enumerate(line.branches):
        yield from _branch(line, branch, main, alignments, f"$.branches[{number}]")
    yield from landmark_problems(line, alignments)


def _of_route(source: Line | Branch, alignment: Alignment, first_m: float, path: str) -> Iterator[Problem]:
    yield from axis_problems(alignment, path)
    yield from place_problems(source, first_m, alignment.length_m, path)
    yield from curve_problems(source.curves, alignment, path)
    yield from gradient_problems(source.gradients, alignment, path)


def _branch(line: Line, branch: Branch, main: Axis, alignments: dict[str, Alignment], path: str) -> Iterator[Problem]:
    """A branch, and how it hangs on the main line."""
    leaves_m = branch.leaves_axis_m
    if fault := junction_fault(main, branch):
        text, advice = fault.split(": ")
        yield error(f"{path}.leaves_axis_m", text, advice)
        return
    try:
        own = axis_through(branch.axis)
        branch_chainage(line, main, branch)
        alignment = alignment_of(line, branch.id)
    except AxisError as wrong:
        yield error(f"{path}.axis[{wrong.vertex}]", wrong.text, "correct or leave out the vertex")
        return
    except ChainageError as wrong:
        if "" in alignments:
            advice = "rows in rising order of axis_m, which goes on from the junction's"
            yield error(f"{path}.chainage", wrong.text, advice)
        return
    gap_m = float(np.linalg.norm(main.at(leaves_m) - own.ecef_m[0]))
    if gap_m > GAP_M:
        text = f"begins {gap_m:.1f} m from the main line at axis_m {leaves_m:g}"
        make = error if gap_m > WIDEST_GAP_M else warning
        yield make(f"{path}.axis[0]", text, "let the branch begin on the main line's axis")
    turned = turn_at_junction_rad(main, branch)
    if turned > DIVERGES_RAD:
        yield error(
            f"{path}.axis",
            f"leaves the main line at an angle of {np.degrees(turned):.0f}°",
            "a branch leaves towards rising axis_m; turn the line round, or describe the branch as a line of its own",
        )
    alignments[branch.id] = alignment
    yield from _of_route(branch, alignment, leaves_m, path)
    yield from _scales(branch, path)


def _scales(source: Line | Branch, path: str) -> Iterator[Problem]:
    """Kilometrage that runs much faster or slower than metres, long jumps, and turns without a broken chain."""
    rose = 0.0
    for number in range(1, len(source.chainage)):
        before, after = source.chainage[number - 1], source.chainage[number]
        long_m, rise_m = after.axis_m - before.axis_m, after.chainage_m - before.chainage_m
        field = f"{path}.chainage[{number}].chainage_m"
        if long_m > 0.0 and abs(abs(rise_m) / long_m - 1.0) > SCALE_OFF:
            text = f"{abs(rise_m):.0f} m of kilometrage over {long_m:.0f} m of axis"
            yield warning(field, text, "check both; a broken chain is two rows at one place")
        if long_m > 0.0 and rise_m * rose < 0.0:
            way = "rises" if rise_m > 0.0 else "falls"
            yield warning(
                field,
                f"kilometrage {way} from {before.chainage_m:g} on, and did not before",
                "check it; where a chain is broken, give both chainages of the place",
            )
        rose = rise_m if long_m > 0.0 else 0.0
        if long_m == 0.0 and abs(rise_m) > LARGEST_JUMP_M:
            yield warning(field, f"the chain breaks by {rise_m:.0f} m", "check both kilometrages")


def _days(line: Line) -> Iterator[Problem]:
    """Days that no calendar has, or in the wrong order."""
    days: list[date] = []
    for name in ("valid_from", "valid_until"):
        given = getattr(line, name)
        if given is None:
            continue
        try:
            days.append(date.fromisoformat(given))
        except ValueError:
            yield error(f"$.{name}", f"{given} is no day", "days are written YYYY-MM-DD")
    if len(days) == 2 and days[1] < days[0]:  # noqa: PLR2004 - both are given
        yield error("$.valid_until", f"{line.valid_until} is before valid_from {line.valid_from}", "exchange them")
