"""A branch joined to the main line: one axis, one kilometrage, one list of everything along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.line import Branch, ChainagePoint, Curve, Gradient, Line, SpeedLimit, Station, Surroundings, Vertex
from services.line.axis import SHORTEST_SEGMENT_M, Axis, axis_of
from services.line.chainage import Chainage, chainage_of
from services.line.profile import Profile, cant_profile, curvature_profile, gradient_profile
from services.numerics.geodesy import enu_about, geodetic_from_ecef

Floats = NDArray[np.float64]
BACKWARDS_RAD: Final = np.pi / 2.0
"""A branch that turns by more where it leaves runs towards falling `axis_m`, which no route does."""
JUNCTION_SLACK_M: Final = 1.0
"""Lengths are rounded: a branch may leave so far beyond the end of the main line."""
Stretch = TypeVar("Stretch", Curve, SpeedLimit, Surroundings)


@dataclass(frozen=True, slots=True)
class Along:
    """What stands along a route, and the profiles that follow from it."""

    curves: tuple[Curve, ...]
    gradients: tuple[Gradient, ...]
    speed_limits: tuple[SpeedLimit, ...]
    stations: tuple[Station, ...]
    surroundings: tuple[Surroundings, ...]
    curvature: Profile
    cant: Profile
    gradient: Profile
    states_gradients: bool
    """Whether the file states any on this route."""


def along(source: Line | Branch) -> Along:
    """Of the main line, or of a branch by itself."""
    return Along(
        curves=source.curves,
        gradients=source.gradients,
        speed_limits=source.speed_limits,
        stations=source.stations,
        surroundings=source.surroundings,
        curvature=curvature_profile(source.curves),
        cant=cant_profile(source.curves),
        gradient=gradient_profile(source.gradients),
        states_gradients=bool(source.gradients),
    )


def along_branch(line: Line, branch: Branch) -> Along:
    """Of the main line up to the junction, then of the branch; what reaches across it is cut there."""
    before, after, leaves_m = along(line), along(branch), branch.leaves_axis_m
    return Along(
        curves=tuple(_cut_curve(one, leaves_m) for one in _before(before.curves, leaves_m)) + after.curves,
        gradients=tuple(one for one in before.gradients if one.axis_m < leaves_m) + after.gradients,
        speed_limits=_before(before.speed_limits, leaves_m) + after.speed_limits,
        stations=tuple(one for one in before.stations if one.axis_m < leaves_m) + after.stations,
        surroundings=_before(before.surroundings, leaves_m) + after.surroundings,
        curvature=before.curvature.until(leaves_m, after.curvature),
        cant=before.cant.until(leaves_m, after.cant),
        gradient=before.gradient.until(leaves_m, after.gradient) if after.states_gradients else before.gradient,
        states_gradients=before.states_gradients,
    )


def branch_of(line: Line, branch: str) -> Branch:
    """The branch with this id. Raises KeyError, naming those that there are."""
    for one in line.branches:
        if one.id == branch:
            return one
    known = ", ".join(one.id for one in line.branches) or "none"
    msg = f"line {line.id} has no branch {branch!r}; it has: {known}"
    raise KeyError(msg)


def axis_through(vertices: Sequence[Vertex]) -> Axis:
    """Axis through the vertices of a line file. Raises AxisError."""
    lon, lat, height = np.array(vertices, float).T
    return axis_of(lat, lon, height)


def junction_fault(main: Axis, branch: Branch) -> str:
    """Why a branch cannot leave where it says that it does; empty where it can."""
    if branch.leaves_axis_m <= 0.0:
        return "a branch leaves beyond the line's beginning: let the main line begin before it"
    if branch.leaves_axis_m > main.length_m + JUNCTION_SLACK_M:
        return f"{branch.leaves_axis_m:g} is beyond the end at {main.length_m:.0f}: give a place of the main line"
    return ""


def turn_at_junction_rad(main: Axis, branch: Branch) -> float:
    """Angle between the main line, towards rising `axis_m`, and a branch where it leaves."""
    own = axis_through(branch.axis)
    return float(np.arccos(np.clip(main.tangent(branch.leaves_axis_m) @ own.tangent(0.0), -1.0, 1.0)))


def branch_axis(main: Axis, branch: Branch) -> Axis:
    """The main axis up to the junction, then the branch's, counted from the junction's `axis_m`.

    A gap between the two (the check of line files reports it) is jumped over without adding length.
    """
    own, leaves_m = axis_through(branch.axis), branch.leaves_axis_m
    kept = main.axis_m < leaves_m - SHORTEST_SEGMENT_M
    ecef = np.concatenate([main.ecef_m[kept], own.ecef_m])
    lat, lon, height = geodetic_from_ecef(*own.ecef_m.T)
    plane = enu_about(main.reference_deg, np.degrees(lat), np.degrees(lon), height)[:, :2]
    return Axis(
        np.concatenate([main.axis_m[kept], leaves_m + own.axis_m]),
        ecef,
        np.ascontiguousarray(np.concatenate([main.plane_m[kept], plane])),
        main.reference_deg,
        np.arange(len(ecef)),
    )


def main_chainage(line: Line, axis: Axis) -> Chainage:
    """Kilometrage of the main line; `axis_m` itself where none is given. Raises ChainageError."""
    if not line.chainage:
        ends = np.array([0.0, axis.length_m])
        return Chainage(ends, ends)
    return chainage_of([one.axis_m for one in line.chainage], [one.chainage_m for one in line.chainage])


def branch_chainage(line: Line, main: Axis, branch: Branch) -> Chainage:
    """Kilometrage of the way onto a branch; it goes on from the main line's where the branch has none of its own."""
    on_main, leaves_m = main_chainage(line, main), branch.leaves_axis_m
    points = [one for one in line.chainage if one.axis_m < leaves_m]
    if not points:
        points = [ChainagePoint(axis_m=0.0, chainage_m=float(on_main.at(0.0)))]
    points.append(ChainagePoint(axis_m=leaves_m, chainage_m=float(on_main.at(leaves_m))))
    points += [one for one in branch.chainage if one.axis_m > leaves_m or one.chainage_m != points[-1].chainage_m]
    if not branch.chainage:
        far_m = leaves_m + axis_through(branch.axis).length_m
        points.append(ChainagePoint(axis_m=far_m, chainage_m=float(Chainage(*_columns(points)).at(far_m))))
    return chainage_of(*_columns(points))


def _columns(points: Sequence[ChainagePoint]) -> tuple[Floats, Floats]:
    return np.array([one.axis_m for one in points]), np.array([one.chainage_m for one in points])


def _before(stretches: tuple[Stretch, ...], axis_m: float) -> tuple[Stretch, ...]:
    """Those that begin before a place, cut there."""
    return tuple(
        one if one.end_axis_m <= axis_m else msgspec.structs.replace(one, end_axis_m=axis_m)
        for one in stretches
        if one.start_axis_m < axis_m
    )


def _cut_curve(curve: Curve, axis_m: float) -> Curve:
    """Without its last transition, where it was cut."""
    return msgspec.structs.replace(curve, transition_out_m=0.0) if curve.end_axis_m == axis_m else curve
