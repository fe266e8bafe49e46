"""The line file: where a line runs, how its kilometrage counts, and what stands along it.

JSON. Coordinates are WGS 84. `axis_m` is true length along the axis from its first vertex, heights
included; `chainage_m` the railway's own kilometrage. A branch has an axis of its own, whose `axis_m`
goes on from that of the place where it leaves the main line, so that a train's way has no jump.

Signs, seen towards rising `axis_m`: curvature and radius positive to the left, gradient positive
uphill, cant positive with the side of its high rail named. Fields that a reader does not know are ignored.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

Vertex = tuple[
    Annotated[float, Meta(ge=-360.0, le=360.0)],
    Annotated[float, Meta(ge=-90.0, le=90.0)],
    Annotated[float, Meta(gt=-20_000.0, lt=20_000.0)],
]
"""Longitude, latitude [deg] and ellipsoidal height of the rail [m]."""
Name = Annotated[str, Meta(min_length=1, max_length=64)]
Place = Annotated[float, Meta(ge=0.0)]
"""`axis_m` [m]."""
Length = Annotated[float, Meta(ge=0.0)]
Side = Literal["left", "right"]
Direction = Literal["up", "down"]
"""`up`: towards rising `axis_m`."""
Day = Annotated[str, Meta(pattern=r"^\d{4}-\d{2}-\d{2}$")]


class ChainagePoint(msgspec.Struct, frozen=True, kw_only=True):
    """A place whose kilometrage is known; two at one place are a broken chain."""

    axis_m: Place
    chainage_m: float


class Curve(msgspec.Struct, frozen=True, kw_only=True):
    """A curve between two straights: transition, arc, transition."""

    start_axis_m: Place
    """Where the first transition begins."""
    end_axis_m: Place
    """Where the last transition ends."""
    transition_in_m: Length = 0.0
    transition_out_m: Length = 0.0
    radius_m: float
    """Of the arc; positive to the left, never 0."""
    cant_mm: Annotated[float, Meta(ge=0.0, le=300.0)] = 0.0
    high_rail: Side | None = None
    """Absent: the outer rail."""
    radius_sigma_m: Length | None = None
    """Standard deviation of the radius, where it was fitted; absent: as designed."""
    place_sigma_m: Length | None = None
    """The same of the places at which its transitions are half done."""


class Gradient(msgspec.Struct, frozen=True, kw_only=True):
    """Gradient from a place on, up to the next one: rise over the length in plan."""

    axis_m: Place
    permille: Annotated[float, Meta(ge=-150.0, le=150.0)]
    vertical_radius_m: Annotated[float, Meta(ge=0.0)] = 3000.0
    """Of the vertical curve that rounds the change to this gradient, half of it on either side; 0: a kink."""


class SpeedLimit(msgspec.Struct, frozen=True, kw_only=True):
    """Highest speed over a stretch."""

    start_axis_m: Place
    end_axis_m: Place
    limit_mps: Annotated[float, Meta(gt=0.0, le=140.0)]


class Station(msgspec.Struct, frozen=True, kw_only=True):
    """A stopping place."""

    id: Name
    name: str
    name_ja: str = ""
    axis_m: Place
    """Where the front end stops."""
    platform_m: Length = 0.0


class Surroundings(msgspec.Struct, frozen=True, kw_only=True):
    """What stands around a stretch, as satellites see it."""

    kind: Literal["tunnel", "cutting", "canyon", "station_roof", "forest"]
    start_axis_m: Place
    end_axis_m: Place


class RadioSite(msgspec.Struct, frozen=True, kw_only=True):
    """A wayside radio."""

    id: Name
    axis_m: Place
    aside_m: float = 0.0
    """Positive to the left."""
    channels: tuple[str, ...] = ()


class TrackCircuit(msgspec.Struct, frozen=True, kw_only=True):
    """A track circuit."""

    id: Name
    start_axis_m: Place
    end_axis_m: Place
    carrier_hz: Annotated[float, Meta(gt=0.0)] | None = None


class Balise(msgspec.Struct, frozen=True, kw_only=True):
    """A balise whose place is known."""

    id: Name
    axis_m: Place
    accuracy_m: Length
    """Location accuracy: error of the place that is vouched for."""


class ParallelTrack(msgspec.Struct, frozen=True, kw_only=True):
    """A track beside the axis, too near for satellites to tell apart."""

    id: Name
    start_axis_m: Place
    end_axis_m: Place
    aside_m: float
    """Distance from the axis, positive to the left."""


class Landmark(msgspec.Struct, frozen=True, kw_only=True):
    """A curve as a virtual balise (Iwata et al., table 1), as a train meets it in one direction.

    Places in the order in which the train passes them: rising for `up`, falling for `down`.
    """

    id: Name
    direction: Direction
    branch: str = ""
    """Empty: the main line."""
    hand: Side
    """Towards which side the train turns, seen by the train."""
    radius_m: Annotated[float, Meta(gt=0.0)]
    entry_straight_start_m: Place
    entry_straight_end_m: Place
    entry_lower_limit_m: Place
    """Where the measured curvature rises above the lower limit."""
    exit_lower_limit_m: Place
    """Where it falls below again: the place that corrects the position."""
    exit_straight_start_m: Place
    exit_straight_end_m: Place
    accuracy_m: Length = 10.0
    """Location accuracy of `exit_lower_limit_m`: error that is vouched for."""
    lower_share: Annotated[float, Meta(gt=0.0, lt=1.0)] = 0.8
    """Lower limit of the curvature, as a share of 1/radius."""
    upper_share: Annotated[float, Meta(gt=1.0, le=2.0)] = 1.2
    length_tolerance_share: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.15
    length_tolerance_m: Length = 15.0
    runs: Annotated[int, Meta(ge=0)] = 0
    """Runs from which it was surveyed; 0 when it follows from the line's geometry alone."""
    spread_m: Length | None = None
    """Standard deviation over these runs of the exit crossing."""


class Branch(msgspec.Struct, frozen=True, kw_only=True):
    """A line that leaves the main one."""

    id: Name
    name: str
    leaves_axis_m: Place
    """Where it leaves; its own `axis_m` goes on from here."""
    side: Side
    """Towards which side it leaves, seen towards rising `axis_m`."""
    axis: Annotated[tuple[Vertex, ...], Meta(min_length=2)]
    chainage: tuple[ChainagePoint, ...] = ()
    curves: tuple[Curve, ...] = ()
    gradients: tuple[Gradient, ...] = ()
    speed_limits: tuple[SpeedLimit, ...] = ()
    stations: tuple[Station, ...] = ()
    surroundings: tuple[Surroundings, ...] = ()


class Line(msgspec.Struct, frozen=True, kw_only=True):
    """A line."""

    id: Name
    name: str
    name_ja: str = ""
    version: str = ""
    """Of this file. A train with another version refuses to match landmarks."""
    valid_from: Day | None = None
    valid_until: Day | None = None
    """Last day on which it may be used."""
    axis: Annotated[tuple[Vertex, ...], Meta(min_length=2)]
    chainage: tuple[ChainagePoint, ...] = ()
    """In order along the axis; chainage is `axis_m` itself when left out."""
    gauge_m: Annotated[float, Meta(gt=0.3, lt=3.0)] = 1.067
    curves: tuple[Curve, ...] = ()
    gradients: tuple[Gradient, ...] = ()
    speed_limits: tuple[SpeedLimit, ...] = ()
    stations: tuple[Station, ...] = ()
    surroundings: tuple[Surroundings, ...] = ()
    radio_sites: tuple[RadioSite, ...] = ()
    track_circuits: tuple[TrackCircuit, ...] = ()
    balises: tuple[Balise, ...] = ()
    parallel_tracks: tuple[ParallelTrack, ...] = ()
    branches: tuple[Branch, ...] = ()
    landmarks: tuple[Landmark, ...] = ()


class LandmarkDatabase(msgspec.Struct, frozen=True, kw_only=True):
    """landmarks.json: landmarks of a line, with where they come from."""

    version: Name
    line: Name
    line_version: str
    origin: str
    """How they were found, in words."""
    evidence: tuple[str, ...] = ()
    """Names of the runs."""
    landmarks: tuple[Landmark, ...]
