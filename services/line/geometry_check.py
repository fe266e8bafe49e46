"""Whether curves and gradients of a line file fit each other, and the axis's own vertices."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.line import Curve, Gradient
from services.line.alignment import Alignment
from services.line.problem import Problem, error, warning
from services.numerics.geodesy import geodetic_from_ecef

Floats = NDArray[np.float64]

SHARE_OFF: Final = 0.2
"""A curve may turn the train by so much more or less than the axis does: vertices are coarse, transitions guessed."""
TURN_OFF_RAD: Final = math.radians(3.0)
"""Or by so much, whichever is more."""
UNNAMED_TURN_RAD: Final = math.radians(6.0)
"""More turn than this outside all curves is a curve that the file does not have."""
SHARPEST_RAD: Final = math.radians(100.0)
"""An axis that turns more than this at a vertex doubles back."""
TIGHTEST_M: Final = 60.0
SMALLEST_RADIUS_M: Final = 1.0
"""A curve tighter than a wheel is none, and its curvature may be no number."""
RISE_OFF_M: Final = 3.0
"""Heights and stated gradients may differ by so much between two changes of gradient …"""
PERMILLE_OFF: Final = 3.0
"""… or by so many per mille, whichever is more."""
LEVEL_M: Final = 1e-3
LONGEST_EDGE_M: Final = 1000.0


def axis_problems(alignment: Alignment, path: str) -> Iterator[Problem]:
    """An axis that doubles back, or has gaps between vertices in which curves could hide."""
    own = _own(alignment)
    step = np.diff(alignment.axis.plane_m, axis=0)
    turn = np.arctan2(step[:-1, 0] * step[1:, 1] - step[:-1, 1] * step[1:, 0], (step[:-1] * step[1:]).sum(axis=1))
    first = int(np.searchsorted(alignment.axis.axis_m, own))
    for k in np.flatnonzero(np.abs(turn) > SHARPEST_RAD).tolist():
        if k + 1 > first:
            yield error(
                f"{path}.axis[{k + 1 - first}]",
                f"the axis turns by {math.degrees(abs(turn[k])):.0f}° at this vertex",
                "leave out the vertex that is out of order",
            )
    long_m = np.diff(alignment.axis.axis_m)
    for k in np.flatnonzero(long_m > LONGEST_EDGE_M).tolist():
        if k >= first:
            yield warning(
                f"{path}.axis[{k + 1 - first}]", f"{long_m[k]:.0f} m to the vertex before", "add the vertices between"
            )


def _own(alignment: Alignment) -> float:
    """Where the part begins that this route alone has."""
    return alignment.junction_axis_m or 0.0


def curve_problems(curves: Sequence[Curve], alignment: Alignment, path: str) -> Iterator[Problem]:
    """Curves that are none, that overlap, and that contradict the axis; `curves` are those of the file's one list."""
    sound: list[Curve] = []
    for number, curve in enumerate(curves):
        found = list(_alone(curve, f"{path}.curves[{number}]"))
        yield from found
        if not found:
            yield from against_axis(curve, alignment, f"{path}.curves[{number}]")
            sound.append(curve)
    for number, (before, after) in enumerate(pairwise(curves), 1):
        if after.start_axis_m < before.start_axis_m:
            yield error(
                f"{path}.curves[{number}].start_axis_m",
                f"{after.start_axis_m:g} after a curve that begins at {before.start_axis_m:g}",
                "put the curves in order along the axis",
            )
        elif after.start_axis_m < before.end_axis_m - 1e-3:
            yield error(
                f"{path}.curves[{number}].start_axis_m",
                f"begins {before.end_axis_m - after.start_axis_m:.1f} m before the curve ahead of it ends",
                "let each curve begin where the one before has ended, or later",
            )
    if len(sound) == len(curves):
        yield from _unnamed(curves, alignment, path)


def _alone(curve: Curve, field: str) -> Iterator[Problem]:
    """What is wrong with a curve whatever the axis does."""
    long_m = curve.end_axis_m - curve.start_axis_m
    if abs(curve.radius_m) < SMALLEST_RADIUS_M or not math.isfinite(curve.radius_m):
        yield error(f"{field}.radius_m", f"{curve.radius_m:g} is no radius", "leave straights out of the list")
    elif abs(curve.radius_m) < TIGHTEST_M:
        yield warning(f"{field}.radius_m", f"{curve.radius_m:g} m is tighter than trains run", "check its unit")
    if long_m <= 0.0:
        yield error(f"{field}.end_axis_m", f"not beyond its start at {curve.start_axis_m:g}", "exchange start and end")
    elif curve.transition_in_m + curve.transition_out_m > long_m + 1e-3:
        both_m = curve.transition_in_m + curve.transition_out_m
        yield error(
            f"{field}.transition_in_m",
            f"transitions of {both_m:g} m in a curve of {long_m:g} m",
            "start and end are those of the transitions, not of the arc",
        )


def against_axis(curve: Curve, alignment: Alignment, field: str) -> Iterator[Problem]:
    """A curve whose turn the vertices do not show."""
    if not 0.0 <= curve.start_axis_m <= curve.end_axis_m <= alignment.length_m + 1.0:
        return
    arc_m = curve.end_axis_m - curve.start_axis_m - (curve.transition_in_m + curve.transition_out_m) / 2.0
    stated = arc_m / curve.radius_m
    # Headings a little outside, where they stand still, so that coarse vertices do not matter.
    reach_m = 10.0
    ends = alignment.heading.at([curve.start_axis_m - reach_m, curve.end_axis_m + reach_m])
    shown = float(ends[0] - ends[1])
    neighbours = [one for one in alignment.curves if one.start_axis_m != curve.start_axis_m]
    near = any(
        one.start_axis_m < curve.end_axis_m + reach_m and one.end_axis_m > curve.start_axis_m - reach_m
        for one in neighbours
    )
    if near:
        ends = alignment.heading.at([curve.start_axis_m, curve.end_axis_m])
        shown = float(ends[0] - ends[1])
    if abs(shown - stated) <= max(SHARE_OFF * abs(stated), TURN_OFF_RAD):
        return
    if shown * stated < 0.0 and abs(shown + stated) <= max(SHARE_OFF * abs(stated), TURN_OFF_RAD):
        advice = "exchange its sign: radii are positive to the left, seen towards rising axis_m"
    else:
        fitting = f"; {arc_m / shown:.0f} m would fit" if abs(shown) > TURN_OFF_RAD else ""
        advice = f"correct the radius or the places{fitting}"
    turns = f"turns by {math.degrees(stated):.1f}°, the axis there by {math.degrees(shown):.1f}°"
    yield error(f"{field}.radius_m", f"radius {curve.radius_m:g} m {turns}", advice)


def _unnamed(curves: Sequence[Curve], alignment: Alignment, path: str) -> Iterator[Problem]:
    """Turns of the axis outside all curves."""
    own_m = _own(alignment)
    edges = [own_m, *(place for one in curves for place in (one.start_axis_m, one.end_axis_m)), alignment.length_m]
    for start_m, end_m in zip(edges[::2], edges[1::2], strict=True):
        if end_m - start_m < 1.0:
            continue
        ends = alignment.heading.at([start_m, end_m])
        turn = float(ends[0] - ends[1])
        if abs(turn) > UNNAMED_TURN_RAD:
            yield warning(
                f"{path}.curves",
                f"the axis turns by {math.degrees(turn):.0f}° from {start_m:.0f} to {end_m:.0f} without a listed curve",
                "add the curve, or let `kirotei line import` fit it",
            )


def gradient_problems(gradients: Sequence[Gradient], alignment: Alignment, path: str) -> Iterator[Problem]:
    """Gradients out of order, or contradicting the heights of the axis."""
    for number, (before, after) in enumerate(pairwise(gradients), 1):
        if after.axis_m <= before.axis_m:
            yield error(
                f"{path}.gradients[{number}].axis_m",
                f"{after.axis_m:g} after {before.axis_m:g}",
                "put the changes of gradient in order along the axis",
            )
            return
    height = np.asarray(geodetic_from_ecef(*alignment.axis.ecef_m.T)[2])
    if not gradients:
        return
    if float(np.ptp(height)) < LEVEL_M and any(one.permille for one in gradients):
        yield warning(f"{path}.axis", "gradients are stated, but all heights are the same", "give the axis its heights")
        return
    places = [one.axis_m for one in gradients] + [alignment.length_m]
    for number, (start_m, end_m) in enumerate(pairwise(places)):
        inside = start_m >= _own(alignment) and end_m <= alignment.length_m + 1.0 and end_m > start_m
        if not inside:
            continue
        along = np.linspace(start_m, end_m, max(math.ceil((end_m - start_m) / 10.0), 1) + 1)
        stated_m = float(np.trapezoid(alignment.gradient_permille(along) / 1000.0, along))
        shown_m = float(np.diff(np.interp([start_m, end_m], alignment.axis.axis_m, height))[0])
        if abs(shown_m - stated_m) > max(RISE_OFF_M, PERMILLE_OFF / 1000.0 * (end_m - start_m)):
            yield error(
                f"{path}.gradients[{number}].permille",
                f"{gradients[number].permille:g} ‰ rise by {stated_m:.1f} m to {end_m:.0f}, heights {shown_m:.1f} m",
                "gradients are per mille, positive uphill towards rising axis_m; heights are metres",
            )
