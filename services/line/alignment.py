"""The way of a train: the main line, or the main line up to a junction and then a branch, as one.

Signs, everywhere in Kirotei, seen towards rising `axis_m`: curvature positive to the left (heading,
clockwise from north, falls there), gradient positive uphill, cant positive with the right rail high
(as in a left-hand curve: the body leans to the left, which is a negative roll about the forward axis).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schemas.line import (
    Balise,
    Branch,
    Curve,
    Gradient,
    Landmark,
    Line,
    ParallelTrack,
    SpeedLimit,
    Station,
    Surroundings,
)
from services.line.axis import Axis
from services.line.chainage import Chainage
from services.line.profile import Profile
from services.line.route import (
    Along,
    along,
    along_branch,
    axis_through,
    branch_axis,
    branch_chainage,
    branch_of,
    main_chainage,
)
from services.numerics.geodesy import geodetic_from_ecef

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

RAIL_HEAD_M: Final = 0.065
"""Width of a rail's head: the rails' centres are the gauge and this apart, over which cant tilts the track."""
HEIGHT_WINDOW_M: Final = 200.0
"""Length over which heights are averaged into a gradient, where the file states none."""


@dataclass(frozen=True, slots=True)
class Alignment:
    """One route of a line. Made by `alignment_of`. Functions of place take any shape and keep it."""

    line: str
    version: str
    branch: str
    """Empty: the main line all the way."""
    junction_axis_m: float | None
    """Where the branch begins; None on the main line."""
    gauge_m: float
    axis: Axis
    chainage: Chainage
    """`chainage.at(axis_m)` and, the other way, `chainage.places(chainage_m)`."""
    curves: tuple[Curve, ...]
    gradients: tuple[Gradient, ...]
    speed_limits: tuple[SpeedLimit, ...]
    stations: tuple[Station, ...]
    surroundings_along: tuple[Surroundings, ...]
    parallel_tracks: tuple[ParallelTrack, ...]
    balises: tuple[Balise, ...]
    landmarks: tuple[Landmark, ...]
    """Those that a train on this route meets, of both directions."""
    curvature: Profile
    cant: Profile
    gradient: Profile
    heading: Profile
    """Unwrapped [rad], clockwise from north."""

    @property
    def length_m(self) -> float:
        """Length of the route."""
        return self.axis.length_m

    def curvature_per_m(self, axis_m: ArrayLike) -> Floats:
        """Curvature of the axis, positive to the left, linear in clothoid transitions."""
        return self.curvature.at(axis_m)

    def gradient_permille(self, axis_m: ArrayLike) -> Floats:
        """Gradient, positive uphill, with vertical curves."""
        return self.gradient.at(axis_m)

    def cant_m(self, axis_m: ArrayLike) -> Floats:
        """Height of the right rail above the left one."""
        return self.cant.at(axis_m)

    def cant_rad(self, axis_m: ArrayLike) -> Floats:
        """Tilt of the track, positive with the right rail high; its roll about the forward axis is minus this."""
        return np.asarray(np.arcsin(self.cant.at(axis_m) / (self.gauge_m + RAIL_HEAD_M)))

    def heading_rad(self, axis_m: ArrayLike) -> Floats:
        """Direction towards rising `axis_m`, clockwise from north, in [0, 2π)."""
        return np.asarray(self.heading.at(axis_m) % (2.0 * np.pi))

    def position(self, axis_m: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Latitude, longitude [deg] and ellipsoidal height [m] of the axis."""
        lat, lon, height = geodetic_from_ecef(*np.moveaxis(self.axis.at(axis_m), -1, 0))
        return np.degrees(lat), np.degrees(lon), np.asarray(height)

    def speed_limit_mps(self, axis_m: ArrayLike) -> Floats:
        """Lowest limit that holds at each place; inf where the file states none."""
        places = np.asarray(axis_m, float)
        lowest = np.full(places.shape, np.inf)
        for limit in self.speed_limits:
            inside = (places >= limit.start_axis_m) & (places <= limit.end_axis_m)
            lowest = np.where(inside, np.minimum(lowest, limit.limit_mps), lowest)
        return np.asarray(lowest)

    def surroundings(self, axis_m: float) -> tuple[Surroundings, ...]:
        """Everything that stands around one place."""
        return tuple(one for one in self.surroundings_along if one.start_axis_m <= axis_m <= one.end_axis_m)

    def inside(
        self, kind: Literal["tunnel", "cutting", "canyon", "station_roof", "forest"], axis_m: ArrayLike
    ) -> Bools:
        """Which places have surroundings of a kind."""
        places = np.asarray(axis_m, float)
        found = np.zeros(places.shape, bool)
        for one in self.surroundings_along:
            if one.kind == kind:
                found |= (places >= one.start_axis_m) & (places <= one.end_axis_m)
        return found


def routes(line: Line) -> tuple[str, ...]:
    """Ids of the routes: the empty one of the main line first, then each branch."""
    return ("", *(branch.id for branch in line.branches))


def alignment_of(line: Line, branch: str = "") -> Alignment:
    """The main line, or the way onto a branch.

    Raises KeyError for an unknown branch, AxisError and ChainageError for geometry that is none.
    """
    main = axis_through(line.axis)
    if not branch:
        return _alignment(line, None, main, main_chainage(line, main), along(line))
    leaving = branch_of(line, branch)
    return _alignment(
        line, leaving, branch_axis(main, leaving), branch_chainage(line, main, leaving), along_branch(line, leaving)
    )


def _alignment(line: Line, branch: Branch | None, axis: Axis, chainage: Chainage, stands: Along) -> Alignment:
    """All of it together."""
    upto_m = branch.leaves_axis_m if branch else axis.length_m
    return Alignment(
        line=line.id,
        version=line.version,
        branch=branch.id if branch else "",
        junction_axis_m=branch.leaves_axis_m if branch else None,
        gauge_m=line.gauge_m,
        axis=axis,
        chainage=chainage,
        curves=stands.curves,
        gradients=stands.gradients,
        speed_limits=stands.speed_limits,
        stations=stands.stations,
        surroundings_along=stands.surroundings,
        parallel_tracks=tuple(one for one in line.parallel_tracks if one.start_axis_m < upto_m),
        balises=tuple(one for one in line.balises if one.axis_m <= upto_m),
        landmarks=tuple(one for one in line.landmarks if _meets(one, branch)),
        curvature=stands.curvature,
        cant=stands.cant,
        gradient=stands.gradient if stands.states_gradients else _gradient_of_heights(axis),
        heading=_headings(axis),
    )


def _meets(landmark: Landmark, branch: Branch | None) -> bool:
    """Whether the whole of a landmark lies on a route."""
    if branch is None or landmark.branch:
        return landmark.branch == (branch.id if branch else "")
    return max(landmark.entry_straight_start_m, landmark.exit_straight_end_m) <= branch.leaves_axis_m


def _headings(axis: Axis) -> Profile:
    """Heading [rad], clockwise from north: that of each segment at its middle, in the local level of its place."""
    middle = (axis.ecef_m[1:] + axis.ecef_m[:-1]) / 2.0
    lat, lon, _ = geodetic_from_ecef(*middle.T)
    step = np.diff(axis.ecef_m, axis=0)
    east = -np.sin(lon) * step[:, 0] + np.cos(lon) * step[:, 1]
    level = np.cos(lon) * step[:, 0] + np.sin(lon) * step[:, 1]
    north = -np.sin(lat) * level + np.cos(lat) * step[:, 2]
    places = (axis.axis_m[1:] + axis.axis_m[:-1]) / 2.0
    return Profile(places, np.unwrap(np.arctan2(east, north)))


def _gradient_of_heights(axis: Axis) -> Profile:
    """Gradient [‰] of the vertices' heights, each over HEIGHT_WINDOW_M about it."""
    height = np.asarray(geodetic_from_ecef(*axis.ecef_m.T)[2])
    first_m = np.maximum(axis.axis_m - HEIGHT_WINDOW_M / 2.0, 0.0)
    last_m = np.minimum(axis.axis_m + HEIGHT_WINDOW_M / 2.0, axis.length_m)
    rise_m = np.interp(last_m, axis.axis_m, height) - np.interp(first_m, axis.axis_m, height)
    return Profile(axis.axis_m, 1000.0 * rise_m / (last_m - first_m))
