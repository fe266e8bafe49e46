"""A line file from a design: clothoids and vertical curves integrated along the ellipsoid to vertices.

Vertices stand on the designed axis, LONGEST_STEP_M apart at most and CURVE_STEP_M in curves: between
them the polyline leaves the axis by no more than step²/(8R), 1 cm at R 300 m. Chords are shorter
than their arcs by step²/(24R²) of their length (12 mm per km at R 300 m); so that `axis_m` is exactly
the length of the polyline in the file, every place of the design is moved by that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.line import Branch, Curve, Line, SpeedLimit, Vertex
from services.line.alignment import alignment_of, routes
from services.line.design import BranchDesign, LineDesign, Stretches
from services.line.landmarks import landmarks_of
from services.line.profile import curvature_profile, gradient_profile
from services.line.route import axis_through
from services.numerics.geodesy import E2, WGS84_A_M

Floats = NDArray[np.float64]
Placed = TypeVar("Placed", bound=msgspec.Struct)

LONGEST_STEP_M: Final = 10.0
CURVE_STEP_M: Final = 5.0
INTEGRATION_STEP_M: Final = 2.5
"""Runge-Kutta of fourth order over this is exact to below 1e-6 m per km at R 100 m."""
CANT_DEFICIENCY_MM: Final = 50.0
"""Unbalanced cant that a curve's speed limit allows, the usual value of narrow-gauge lines in Japan."""
GRAVITY_MPS2: Final = 9.80665
SPEED_STEP_MPS: Final = 5.0 / 3.6
"""Speed limits are posted in steps of 5 km/h."""
PLACES: Final = ("axis_m", "start_axis_m", "end_axis_m")


@dataclass(frozen=True, slots=True)
class _Pose:
    """Where the axis is and goes: latitude, longitude, heading clockwise from north [rad], height [m]."""

    lat_rad: float
    lon_rad: float
    heading_rad: float
    h_m: float


@dataclass(frozen=True, slots=True)
class _Laid:
    """A piece of line laid onto the ellipsoid."""

    design_m: Floats
    """Of each vertex."""
    axis_m: Floats
    """Of each vertex, along the polyline."""
    vertices: tuple[Vertex, ...]
    poses: tuple[_Pose, ...]


def line_of(design: LineDesign) -> Line:
    """The line file of a design, with landmarks derived from its curves."""
    start = _Pose(
        math.radians(design.start_lat_deg),
        math.radians(design.start_lon_deg),
        math.radians(design.start_heading_deg),
        design.start_h_m,
    )
    main = _lay(design, 0.0, 0.0, start)
    line = Line(
        id=design.id,
        name=design.name,
        name_ja=design.name_ja,
        version=design.version,
        valid_from=design.valid_from,
        valid_until=design.valid_until,
        gauge_m=design.gauge_m,
        axis=main.vertices,
        **_stretches(design, design.gauge_m, 0.0, main),
        radio_sites=_moved(design.radio_sites, main),
        track_circuits=_moved(design.track_circuits, main),
        balises=_moved(design.balises, main),
        parallel_tracks=_moved(design.parallel_tracks, main),
        branches=tuple(_branch(one, design.gauge_m, main) for one in design.branches),
    )
    found = [
        landmark
        for route in routes(line)
        for landmark in landmarks_of(alignment_of(line, route), accuracy_m=design.landmark_accuracy_m)
    ]
    return msgspec.structs.replace(line, landmarks=tuple(found))


def _branch(design: BranchDesign, gauge_m: float, main: _Laid) -> Branch:
    """A branch from the main line's pose at its junction on."""
    number = int(np.argmin(np.abs(main.design_m - design.leaves_axis_m)))
    leaves_m = round(float(main.axis_m[number]), 3)
    laid = _lay(design, float(main.design_m[number]), leaves_m, main.poses[number])
    return Branch(
        id=design.id,
        name=design.name,
        side=design.side,
        leaves_axis_m=leaves_m,
        axis=laid.vertices,
        **_stretches(design, gauge_m, float(main.design_m[number]), laid),
    )


def _stretches(design: Stretches, gauge_m: float, start_m: float, laid: _Laid) -> dict[str, Any]:
    """Fields that `Line` and `Branch` have in common."""
    curves = _curves(design, start_m)
    return {
        "curves": _moved(curves, laid),
        "gradients": _moved(design.gradients, laid),
        "chainage": _moved(design.chainage, laid),
        "stations": _moved(design.stations, laid),
        "surroundings": _moved(design.surroundings, laid),
        "speed_limits": _moved(_limits(design, curves, gauge_m, start_m), laid),
    }


def _curves(design: Stretches, start_m: float) -> tuple[Curve, ...]:
    """Curves among the elements, one after another."""
    found: list[Curve] = []
    for element in design.elements:
        end_m = start_m + element.length_m
        if element.radius_m is not None:
            found.append(
                Curve(
                    start_axis_m=start_m,
                    end_axis_m=end_m,
                    transition_in_m=element.transition_m,
                    transition_out_m=element.transition_m,
                    radius_m=element.radius_m,
                    cant_mm=element.cant_mm,
                )
            )
        start_m = end_m
    return tuple(found)


def curve_limit_mps(radius_m: float, cant_mm: float, gauge_m: float) -> float:
    """Speed at which the lateral acceleration is that of CANT_DEFICIENCY_MM, down to a posted one.

    v² = g R (cant + deficiency)/gauge, the balance of forces in a canted curve.

    >>> round(curve_limit_mps(300.0, 90.0, 1.067) * 3.6)
    70
    """
    square = GRAVITY_MPS2 * abs(radius_m) * (cant_mm + CANT_DEFICIENCY_MM) / 1000.0 / gauge_m
    return math.floor(math.sqrt(square) / SPEED_STEP_MPS) * SPEED_STEP_MPS


def _limits(design: Stretches, curves: tuple[Curve, ...], gauge_m: float, start_m: float) -> tuple[SpeedLimit, ...]:
    """The line's own limit, those of the curves that need a lower one, and those that the design adds."""
    end_m = start_m + sum(element.length_m for element in design.elements)
    limits = [SpeedLimit(start_axis_m=start_m, end_axis_m=end_m, limit_mps=design.highest_speed_mps)]
    for curve in curves:
        limit_mps = curve_limit_mps(curve.radius_m, curve.cant_mm, gauge_m)
        if limit_mps < design.highest_speed_mps:
            limits.append(SpeedLimit(start_axis_m=curve.start_axis_m, end_axis_m=curve.end_axis_m, limit_mps=limit_mps))
    return (*limits, *design.speed_limits)


def _moved(placed: tuple[Placed, ...], laid: _Laid) -> tuple[Placed, ...]:
    """With every place of the design as `axis_m`, in whole millimetres."""
    moved = []
    for one in placed:
        onto = {
            name: round(float(np.interp(getattr(one, name), laid.design_m, laid.axis_m)), 3)
            for name in PLACES
            if hasattr(one, name)
        }
        moved.append(msgspec.structs.replace(one, **onto))
    return tuple(moved)


def _lay(design: Stretches, start_m: float, start_axis_m: float, pose: _Pose) -> _Laid:
    """Vertices from a pose on."""
    vertex_m = _vertex_places(design, start_m)
    curvature = curvature_profile(_curves(design, start_m))
    gradient = gradient_profile(design.gradients)
    poses = [pose]
    for here_m, next_m in zip(vertex_m[:-1].tolist(), vertex_m[1:].tolist(), strict=True):
        count = max(math.ceil((next_m - here_m) / INTEGRATION_STEP_M), 1)
        step_m = (next_m - here_m) / count
        middles = here_m + step_m * (np.arange(2 * count + 1) / 2.0)
        bends = curvature.at(middles.clip(here_m + 1e-5, next_m - 1e-5)).tolist()
        slopes = (gradient.at(middles) / 1000.0).tolist()
        for k in range(count):
            pose = _stepped(pose, step_m, bends[2 * k : 2 * k + 3], slopes[2 * k : 2 * k + 3])
        poses.append(pose)
    vertices = tuple(
        (round(math.degrees(one.lon_rad), 9), round(math.degrees(one.lat_rad), 9), round(one.h_m, 4)) for one in poses
    )
    axis_m = start_axis_m + axis_through(vertices).axis_m
    return _Laid(vertex_m, axis_m, vertices, tuple(poses))


def _vertex_places(design: Stretches, start_m: float) -> Floats:
    """Metres of the design at which vertices stand: the ends of every piece, and evenly between."""
    places = [start_m]
    for element in design.elements:
        pieces = (
            [(element.straight_m, LONGEST_STEP_M)]
            if element.straight_m is not None
            else [(long_m, CURVE_STEP_M) for long_m in (element.transition_m, element.arc_m, element.transition_m)]
        )
        for long_m, longest_m in pieces:
            if long_m > 0.0:
                count = math.ceil(long_m / longest_m)
                places += [places[-1] + long_m * (k + 1) / count for k in range(count)]
    return np.array(places)


def _stepped(pose: _Pose, step_m: float, bends: list[float], slopes: list[float]) -> _Pose:
    """One Runge-Kutta step; curvature and gradient are given at its start, middle and end."""
    start = (pose.lat_rad, pose.lon_rad, pose.heading_rad, pose.h_m)
    first = _rates(start, bends[0], slopes[0])
    second = _rates(_after(start, first, step_m / 2.0), bends[1], slopes[1])
    third = _rates(_after(start, second, step_m / 2.0), bends[1], slopes[1])
    last = _rates(_after(start, third, step_m), bends[2], slopes[2])
    mean = tuple((a + 2.0 * b + 2.0 * c + d) / 6.0 for a, b, c, d in zip(first, second, third, last, strict=True))
    return _Pose(*_after(start, mean, step_m))


def _after(state: tuple[float, ...], rates: tuple[float, ...], step_m: float) -> tuple[float, ...]:
    return tuple(one + step_m * rate for one, rate in zip(state, rates, strict=True))


def _rates(state: tuple[float, ...], bend_per_m: float, slope: float) -> tuple[float, ...]:
    """Change of latitude, longitude, heading and height per metre of rail.

    Over the ellipsoid a straight line's heading changes by tan(latitude)·sin(heading)/N per metre
    (Clairaut); curvature, positive to the left, takes away from it.
    """
    lat, _, heading, h_m = state
    square = 1.0 - E2 * math.sin(lat) ** 2
    across_m = WGS84_A_M / math.sqrt(square) + h_m
    along_m = WGS84_A_M * (1.0 - E2) / square**1.5 + h_m
    plan = 1.0 / math.sqrt(1.0 + slope * slope)
    north, east = plan * math.cos(heading), plan * math.sin(heading)
    turn = east * math.tan(lat) / across_m - bend_per_m
    return north / along_m, east / (across_m * math.cos(lat)), turn, plan * slope
