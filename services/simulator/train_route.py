"""A train's route on a line, as the track that it feels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schemas.line import Direction
from services.line.alignment import Alignment
from services.simulator.track_table import STEP_M, TrackTable, roughened
from services.simulator.train_scenario import Journey

Floats = NDArray[np.float64]


class RouteError(ValueError):
    """A journey that the line does not allow."""


@dataclass(frozen=True, slots=True, eq=False)
class TrainRoute:
    """A track with where it lies; way and `axis_m` are turned into each other by trip."""

    track: TrackTable
    """As the train meets it on its first trip."""
    alignment: Alignment
    direction: Direction
    start_m: float
    """Way at which the front end starts."""

    def rises(self, trip: int) -> bool:
        """Whether `axis_m` rises on this trip."""
        return (self.direction == "up") == (trip % 2 == 0)

    def axis_of(self, way_m: float, trip: int) -> float:
        """`axis_m` of a way along the track of a trip."""
        return way_m if self.rises(trip) else self.track.length_m - way_m

    def places_of(self, way_m: Floats, trip: NDArray[np.int64]) -> Floats:
        """The same for columns of ways and trips, as a motion log has them."""
        rises = (trip % 2 == 0) == (self.direction == "up")
        return np.asarray(np.where(rises, way_m, self.track.length_m - way_m))

    def way_of(self, axis_m: float) -> float:
        """Way along the first trip's track."""
        return axis_m if self.direction == "up" else self.track.length_m - axis_m


def route_of(alignment: Alignment, journey: Journey) -> TrainRoute:
    """The route of a journey; the rail's irregularities belong to it. Raises RouteError."""
    places = np.arange(int(alignment.length_m / STEP_M) + 1) * STEP_M
    stops = _stops(alignment, journey)
    track = roughened(
        TrackTable(
            alignment.curvature_per_m(places),
            np.sin(np.arctan(alignment.gradient_permille(places) / 1000.0)),
            -alignment.cant_rad(places),
            np.minimum(alignment.speed_limit_mps(places), 100.0),
            stops,
        ),
        np.random.default_rng(journey.irregularity_seed),
        journey.irregularity,
    )
    start = journey.start_axis_m
    if start is None:
        start = float(stops[0] if journey.direction == "up" else stops[-1])
    if not 0.0 <= start <= track.length_m:
        msg = f"journey.start_axis_m {start:g} lies outside the route's {track.length_m:.0f} m"
        raise RouteError(msg)
    route = TrainRoute(track if journey.direction == "up" else track.reversed_way(), alignment, journey.direction, 0.0)
    return TrainRoute(route.track, alignment, journey.direction, route.way_of(start))


def _stops(alignment: Alignment, journey: Journey) -> Floats:
    """Places of the stops, rising with axis_m."""
    known = {station.id: station.axis_m for station in alignment.stations}
    for name in journey.stops:
        if name not in known:
            msg = f"journey.stops: no station {name!r} on this route; there are: {', '.join(known)}"
            raise RouteError(msg)
    chosen = [known[name] for name in journey.stops] if journey.stops else list(known.values())
    if not chosen:
        msg = f"the line {alignment.line} has no station on this route to stop at"
        raise RouteError(msg)
    return np.array(sorted(chosen))
