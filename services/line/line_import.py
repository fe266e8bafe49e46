"""A line file from a map: tracks put together, smoothed, its curves fitted, stations and heights placed along it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.line import Branch, ChainagePoint, Curve, Line, ParallelTrack, Station
from services.line.alignment import alignment_of, routes
from services.line.chainage import Chainage
from services.line.geometry_check import against_axis
from services.line.imported_profile import ProfileAlong
from services.line.laid_way import LaidWay, lay, lay_branch
from services.line.landmarks import landmarks_of
from services.line.projection import follow
from services.line.smoothing import lengths_m, smooth
from services.line.station_placing import MapStation, PlacedStation, place, rises_with_line
from services.line.stitching import GAP_M, Stitched, stitch
from services.numerics.geodesy import enu_about

Floats = NDArray[np.float64]

TRACK_SAMPLES: Final = 50
UNCOVERED_M: Final = 500.0
"""Tracks go on so far behind the last station; more is worth a note."""
APART_M: Final = 2.0
"""A branch further from the main line than this has left it: beyond the width of a turnout."""


class ImportRefusedError(ValueError):
    """Maps from which no line can be made."""


@dataclass(frozen=True, slots=True)
class GivenStation:
    """A station of the map; `lonlat_deg` (2,) is its middle."""

    name: str
    name_ja: str
    lonlat_deg: Floats
    chainage_m: float | None


@dataclass(frozen=True, slots=True)
class Wishes:
    """What the person who imports decides."""

    name: str = ""
    line_id: str = ""
    version: str = ""
    start: str = ""
    """Station at whose end `axis_m` begins; empty: as kilometrage rises, or else the stations' order in the map."""
    gap_m: float = GAP_M
    reversals: bool = False
    gauge_m: float = 1.067
    landmark_accuracy_m: float = 10.0
    vertex_accuracy_m: float = 0.3
    """What the map's vertices err by at least."""
    profile_by_chainage: bool = False


@dataclass(frozen=True, slots=True)
class Imported:
    """What came of it."""

    line: Line
    notes: tuple[str, ...]
    """What was guessed, closed or left out."""
    length_m: float
    """Of the main line."""
    noise_m: float
    """Estimated error of the map's vertices across the main line."""


def import_line(
    tracks: Sequence[Floats], stations: Sequence[GivenStation], wishes: Wishes, profile: ProfileAlong | None = None
) -> Imported:
    """A line file of tracks (n, 2: longitude, latitude [deg]) and stations.

    Raises StitchingError and ImportRefusedError.
    """
    reference = (float(tracks[0][0, 1]), float(tracks[0][0, 0]), 0.0)
    known = [
        MapStation(one.name, one.name_ja, _plane(reference, one.lonlat_deg[None, :])[0], one.chainage_m)
        for one in stations
    ]
    stitched = stitch([_plane(reference, one) for one in tracks], gap_m=wishes.gap_m, reversals=wishes.reversals)
    notes = list(stitched.notes)
    main_m, turned = _oriented(stitched, known, wishes.start)
    axis = smooth(main_m, wishes.vertex_accuracy_m)
    placed, _ = place(known, [(axis.along_m, axis.plane_m)])
    heights = _profile_along(profile, placed, wishes, float(axis.along_m[-1]), turned=turned and len(tracks) == 1)
    if heights is None:
        notes.append("no profile: the axis lies on the ellipsoid, and no gradients are stated")
    else:
        notes += _covered(heights, float(axis.along_m[-1]))
    main = lay(reference, axis, heights.heights_m(axis.along_m) if heights else np.zeros(len(axis.along_m)), 0.0)
    branches = _branches(reference, stitched, main, wishes.vertex_accuracy_m, notes)
    ways = [(way.smooth.along_m, way.smooth.plane_m) for way in (main, *(branch for branch, _ in branches))]
    placed, left_out = place(known, ways)
    line = Line(
        id=wishes.line_id or slug(wishes.name) or "line",
        name=wishes.name or wishes.line_id or "line",
        name_ja="" if wishes.name.isascii() else wishes.name,
        version=wishes.version,
        gauge_m=wishes.gauge_m,
        axis=main.vertices,
        chainage=_chainage(placed, main, notes),
        curves=main.curves(),
        gradients=heights.gradients(float(axis.along_m[-1])) if heights else (),
        speed_limits=heights.speed_limits(float(main.axis_m[-1])) if heights else (),
        stations=_stations(placed, 0, main),
        parallel_tracks=_parallel(stitched, main),
        branches=tuple(
            _branch(number, way, leaves_m, main, placed) for number, (way, leaves_m) in enumerate(branches, 1)
        ),
    )
    line = _without_contradictions(line, notes)
    return Imported(
        _with_landmarks(line, wishes.landmark_accuracy_m), (*notes, *left_out), float(main.axis_m[-1]), axis.noise_m
    )


def slug(name: str) -> str:
    """A name as an id: small letters, digits and hyphens; empty for a name without any.

    >>> slug("Line 80, Budapest")
    'line-80-budapest'
    """
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:64]


def _plane(reference_deg: tuple[float, float, float], lonlat_deg: Floats) -> Floats:
    """East and north (n, 2) of places on the ellipsoid."""
    lon, lat = lonlat_deg[:, 0], lonlat_deg[:, 1]
    return np.ascontiguousarray(enu_about(reference_deg, lat, lon, np.zeros(len(lat)))[:, :2])


def _oriented(stitched: Stitched, stations: Sequence[MapStation], start: str) -> tuple[Floats, bool]:
    """The main line from its beginning, and whether it was turned round for that."""
    main = stitched.main_m
    placed, _ = place(stations, [(lengths_m(main), main)])
    rising: bool | None
    if start:
        wanted = [one for one in placed if start in (one.station.name, one.station.name_ja)]
        if not wanted:
            known = ", ".join(one.station.name for one in placed) or "none"
            msg = f"no station {start!r} on the main line; stations on it: {known}"
            raise ImportRefusedError(msg)
        rising = wanted[0].along_m < lengths_m(main)[-1] / 2.0
    else:
        rising = rises_with_line(placed, stations)
    return (main[::-1], True) if rising is False else (main, False)


def _profile_along(
    profile: ProfileAlong | None, placed: Sequence[PlacedStation], wishes: Wishes, length_m: float, *, turned: bool
) -> ProfileAlong | None:
    """The profile with places along the line as it runs now."""
    if profile is None or not wishes.profile_by_chainage:
        return profile.turned(length_m) if profile is not None and turned else profile
    known = [(one.along_m, one.station.chainage_m) for one in placed if one.station.chainage_m is not None]
    if len(known) < 2:  # noqa: PLR2004 - a scale needs two places
        msg = "a profile by chainage_m needs two stations or more with a kilometrage"
        raise ImportRefusedError(msg)
    along, chainage = np.array(known, float).T
    ends = np.array([0.0, *along, length_m])
    scale = 1.0 if chainage[-1] >= chainage[0] else -1.0
    figures = [chainage[0] - scale * along[0], *chainage, chainage[-1] + scale * (length_m - along[-1])]
    distinct = np.concatenate([[True], np.diff(ends) > 0.0])
    return profile.by_axis(Chainage(ends[distinct], np.array(figures)[distinct]))


def _covered(profile: ProfileAlong, length_m: float) -> list[str]:
    """A note where heights cover part of the line alone. Raises ImportRefusedError for a profile that covers none.

    Gradients and limits go on from their last row, so their end needs no note.
    """
    first_m, last_m = profile.span_m()
    by_height = profile.height_m is not None
    if first_m >= length_m or (by_height and last_m < 0.0):
        msg = f"no row of the profile lies on the line, which is {length_m:.0f} m long: its places are in metres"
        raise ImportRefusedError(msg)
    if by_height and max(first_m, length_m - last_m) > UNCOVERED_M:
        covered = f"axis_m {max(first_m, 0.0):.0f} to {min(last_m, length_m):.0f} of {length_m:.0f} m"
        return [f"the profile covers {covered}; beyond, heights are level"]
    return []


def _branches(
    reference_deg: tuple[float, float, float],
    stitched: Stitched,
    main: LaidWay,
    vertex_accuracy_m: float,
    notes: list[str],
) -> list[tuple[LaidWay, float]]:
    """Branches that leave towards rising `axis_m`, with where they leave, in order."""
    found: list[tuple[LaidWay, float]] = []
    for branch in stitched.branches:
        laid = lay_branch(reference_deg, branch.plane_m, main, vertex_accuracy_m)
        if laid is None:
            long_m = lengths_m(branch.plane_m)[-1]
            notes.append(
                f"a branch of {long_m:.0f} m leaves towards falling axis_m and is left out: "
                "import it from the other end (--start), or as a line of its own"
            )
        else:
            found.append(laid)
    return sorted(found, key=lambda one: one[1])


def _branch(number: int, way: LaidWay, leaves_m: float, main: LaidWay, placed: Sequence[PlacedStation]) -> Branch:
    """A branch of the line file."""
    return Branch(
        id=f"branch-{number}",
        name=f"Branch {number}",
        leaves_axis_m=leaves_m,
        side=_side(main, way),
        axis=way.vertices,
        curves=way.curves(),
        stations=_stations(placed, number, way),
    )


def _stations(placed: Sequence[PlacedStation], way: int, laid: LaidWay) -> tuple[Station, ...]:
    """Stations of a way, in order."""
    return tuple(
        Station(
            id=f"S{number:02d}" if way == 0 else f"B{way}S{number:02d}",
            name=one.station.name or f"Station {number}",
            name_ja=one.station.name_ja or ("" if one.station.name.isascii() else one.station.name),
            axis_m=laid.to_axis(one.along_m),
        )
        for number, one in enumerate((one for one in placed if one.way == way), 1)
    )


def _chainage(placed: Sequence[PlacedStation], main: LaidWay, notes: list[str]) -> tuple[ChainagePoint, ...]:
    """Kilometrage as the stations give it; one that runs against the line's direction is left out."""
    known = [one for one in placed if one.way == 0 and one.station.chainage_m is not None]
    points: list[ChainagePoint] = []
    rises = not known or (known[-1].station.chainage_m or 0.0) >= (known[0].station.chainage_m or 0.0)
    for one in known:
        point = ChainagePoint(axis_m=main.to_axis(one.along_m), chainage_m=one.station.chainage_m or 0.0)
        if points and point.axis_m <= points[-1].axis_m:
            continue
        if points and (point.chainage_m > points[-1].chainage_m) != rises:
            notes.append(f"kilometrage {point.chainage_m:g} m of station {one.station.name} runs backwards, left out")
            continue
        points.append(point)
    if len(points) == 1:
        far_m, only = float(main.axis_m[-1]), points[0]
        if far_m - only.axis_m < 1.0:
            return (ChainagePoint(axis_m=0.0, chainage_m=only.chainage_m - only.axis_m), only)
        points.append(ChainagePoint(axis_m=far_m, chainage_m=only.chainage_m + far_m - only.axis_m))
    return tuple(points)


def _side(main: LaidWay, branch: LaidWay) -> Literal["left", "right"]:
    """Towards which side a branch leaves: where it is once it is well apart."""
    start_m = float(np.interp(branch.axis_m[0], main.axis_m, main.along_m))
    plane = branch.smooth.plane_m
    aside = follow(main.beside, plane, np.full(len(plane), 200.0), start_m)[:, 1]
    apart = aside[np.abs(aside) > APART_M]
    return "left" if (float(apart[0]) if len(apart) else float(aside[-1])) >= 0.0 else "right"


def _parallel(stitched: Stitched, main: LaidWay) -> tuple[ParallelTrack, ...]:
    """Tracks beside the main line."""
    found: list[ParallelTrack] = []
    for number, track in enumerate(stitched.parallel, 1):
        length = lengths_m(track.plane_m)
        wanted = np.linspace(0.0, length[-1], TRACK_SAMPLES)
        points = np.stack([np.interp(wanted, length, track.plane_m[:, k]) for k in range(2)], axis=1)
        feet = follow(main.beside, points, np.full(len(points), max(200.0, length[-1] / 10.0)))
        found.append(
            ParallelTrack(
                id=f"track-{number}",
                start_axis_m=main.to_axis(float(feet[:, 0].min())),
                end_axis_m=main.to_axis(float(feet[:, 0].max())),
                aside_m=round(float(np.median(feet[:, 1])), 2),
            )
        )
    return tuple(found)


def _without_contradictions(line: Line, notes: list[str]) -> Line:
    """Without the curves that the axis, as smoothed, does not bear out."""

    def sound(curves: Sequence[Curve], route: str) -> tuple[Curve, ...]:
        alignment = alignment_of(line, route)
        return tuple(one for one in curves if not list(against_axis(one, alignment, "")))

    listed = _curve_count(line)
    while True:
        before = _curve_count(line)
        branches = tuple(msgspec.structs.replace(one, curves=sound(one.curves, one.id)) for one in line.branches)
        line = msgspec.structs.replace(line, curves=sound(line.curves, ""), branches=branches)
        if _curve_count(line) == before:
            break
    if before < listed:
        notes.append(f"{listed - before} curves that turn otherwise than the axis does are left out")
    return line


def _curve_count(line: Line) -> int:
    return len(line.curves) + sum(len(one.curves) for one in line.branches)


def _with_landmarks(line: Line, accuracy_m: float) -> Line:
    """With the landmarks that follow from its curves."""
    found = [one for route in routes(line) for one in landmarks_of(alignment_of(line, route), accuracy_m=accuracy_m)]
    return msgspec.structs.replace(line, landmarks=tuple(found))
