"""What the matching knows of a line: landmarks and curves of every way that a train may take, with their versions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from schemas.line import Curve, Direction, Landmark, LandmarkDatabase, Line
from services.landmark_matching.curvature_route import Route, route_of
from services.landmark_matching.curve_shape import shape_of_landmark
from services.line.alignment import alignment_of, routes
from services.line.landmarks import landmarks_of

DIRECTIONS: Final[tuple[Direction, ...]] = ("up", "down")


class DatabaseError(ValueError):
    """A database that does not go with the line."""


@dataclass(frozen=True, slots=True)
class Junction:
    """Where a branch leaves the main line."""

    branch: str
    axis_m: float


@dataclass(frozen=True, slots=True)
class LineLandmarks:
    """By branch, the empty one being the main line."""

    line: str
    line_version: str
    database_version: str
    landmarks: dict[str, tuple[Landmark, ...]]
    curves: dict[str, tuple[Curve, ...]]
    junctions: tuple[Junction, ...]
    routes: tuple[Route, ...]
    """Where the track turns, for both directions of every way."""

    def routes_of(self, direction: Direction) -> list[Route]:
        """Every way in one direction."""
        return [route for route in self.routes if route.direction == direction]


def line_landmarks(line: Line, database: LandmarkDatabase | None = None) -> LineLandmarks:
    """Landmarks of a surveyed database, else those of the line file, else those that its geometry gives.

    Raises DatabaseError for a database of another line or version, ShapeError for rows that make no curve.
    """
    if database is not None:
        _require_same(line, database)
    alignments = {branch: alignment_of(line, branch) for branch in routes(line)}
    version = database.version if database else f"line {line.version}".strip()
    landmarks, junctions = {}, []
    geometric = [] if database or line.landmarks else [one for a in alignments.values() for one in landmarks_of(a)]
    known = database.landmarks if database else line.landmarks or tuple(geometric)
    for branch, alignment in alignments.items():
        junction_m = alignment.junction_axis_m
        if junction_m is not None:
            junctions.append(Junction(branch, junction_m))
        landmarks[branch] = tuple(one for one in known if _meets(one, branch, junction_m))
    for landmark in known:
        shape_of_landmark(landmark)
        if landmark.branch not in alignments:
            msg = f"landmark {landmark.id}: the line has no branch {landmark.branch!r}"
            raise DatabaseError(msg)
        _require_on_line(landmark, alignments[landmark.branch].length_m)
    return LineLandmarks(
        line=line.id,
        line_version=line.version,
        database_version=version,
        landmarks=landmarks,
        curves={branch: alignment.curves for branch, alignment in alignments.items()},
        junctions=tuple(junctions),
        routes=tuple(route_of(one, direction) for one in alignments.values() for direction in DIRECTIONS),
    )


def _require_same(line: Line, database: LandmarkDatabase) -> None:
    if database.line != line.id:
        msg = f"the landmarks are those of line {database.line!r}, not of {line.id!r}"
        raise DatabaseError(msg)
    if database.line_version != line.version:
        msg = f"the landmarks were made for version {database.line_version!r} of the line, it has {line.version!r}"
        raise DatabaseError(msg)


def _require_on_line(landmark: Landmark, length_m: float) -> None:
    last_m = max(landmark.entry_lower_limit_m, landmark.exit_lower_limit_m)
    if last_m > length_m:
        msg = f"landmark {landmark.id}: its curve at {last_m:g} m is beyond the line's end at {length_m:.0f} m; places"
        msg += " are axis_m, true metres, not kilometrage"
        raise DatabaseError(msg)


def _meets(landmark: Landmark, branch: str, junction_m: float | None) -> bool:
    """Whether a train on the way to a branch meets the landmark."""
    if landmark.branch or junction_m is None:
        return landmark.branch == branch
    return max(landmark.entry_straight_start_m, landmark.exit_straight_end_m) <= junction_m
