"""A line as an engineer designs it: straights and curves one after another, and what stands along them.

Places are in metres of the design (the sum of its elements' lengths); the builder turns them into
`axis_m` of the polyline that it makes.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from schemas.line import (
    Balise,
    ChainagePoint,
    Day,
    Gradient,
    Name,
    ParallelTrack,
    RadioSite,
    Side,
    SpeedLimit,
    Station,
    Surroundings,
    TrackCircuit,
)


class Element(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A straight, or a curve: transition, arc, transition."""

    straight_m: Annotated[float, Meta(gt=0.0)] | None = None
    radius_m: float | None = None
    """Positive to the left."""
    arc_m: Annotated[float, Meta(gt=0.0)] = 1.0
    """Length of the arc alone."""
    transition_m: Annotated[float, Meta(ge=0.0)] = 0.0
    """Length of each of the two clothoids."""
    cant_mm: Annotated[float, Meta(ge=0.0, le=200.0)] = 0.0

    def __post_init__(self) -> None:
        """Refuse what is both a straight and a curve, or neither."""
        if (self.straight_m is None) == (self.radius_m is None) or self.radius_m == 0.0:
            msg = "an element has either straight_m or a radius_m that is not 0"
            raise ValueError(msg)

    @property
    def length_m(self) -> float:
        """Transitions included."""
        return self.straight_m if self.straight_m is not None else self.arc_m + 2.0 * self.transition_m


class Stretches(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the main line and a branch both have."""

    elements: Annotated[tuple[Element, ...], Meta(min_length=1)]
    highest_speed_mps: Annotated[float, Meta(gt=0.0)]
    """Of the line; curves have lower limits where their radius and cant demand them."""
    gradients: tuple[Gradient, ...] = ()
    chainage: tuple[ChainagePoint, ...] = ()
    stations: tuple[Station, ...] = ()
    surroundings: tuple[Surroundings, ...] = ()
    speed_limits: tuple[SpeedLimit, ...] = ()
    """Besides those of line and curves."""


class BranchDesign(Stretches, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A branch; its places go on from the junction's."""

    id: Name
    name: str
    side: Side
    leaves_axis_m: Annotated[float, Meta(ge=0.0)]


class LineDesign(Stretches, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A line with its branches."""

    id: Name
    name: str
    name_ja: str = ""
    version: str
    valid_from: Day | None = None
    valid_until: Day | None = None
    gauge_m: float = 1.067
    start_lat_deg: float
    start_lon_deg: float
    start_h_m: float
    start_heading_deg: float
    """Clockwise from north."""
    landmark_accuracy_m: float
    radio_sites: tuple[RadioSite, ...] = ()
    track_circuits: tuple[TrackCircuit, ...] = ()
    balises: tuple[Balise, ...] = ()
    parallel_tracks: tuple[ParallelTrack, ...] = ()
    branches: tuple[BranchDesign, ...] = ()
