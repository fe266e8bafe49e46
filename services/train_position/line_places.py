"""Places on a line as the position needs them: balises, kilometrage, satellites' places on every route."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date, timedelta
from typing import Final

import numpy as np

from schemas.line import Balise, Line
from services.line.alignment import Alignment, alignment_of, routes
from services.line.projection import candidates, follow
from services.line.validity import line_validity

FARTHEST_M: Final = 200.0
"""A fix further beside a route does not belong to it."""
EPOCH: Final = date(1970, 1, 1)
DAY_NS: Final = 86_400 * 1_000_000_000
FIRST_DAY_NS: Final = 10_957 * DAY_NS
"""1 January 2000."""


@dataclass(frozen=True, slots=True)
class Foot:
    """Where a place falls on a route."""

    axis_m: float
    aside_m: float


class LinePlaces:
    """A line, looked up by place."""

    def __init__(self, line: Line) -> None:
        """Lay out every route. Raises AxisError and ChainageError for geometry that is none."""
        self.id = line.id
        self.version = line.version
        self.routes: dict[str, Alignment] = {route: alignment_of(line, route) for route in routes(line)}
        self.leaves_m: dict[str, float] = {branch.id: branch.leaves_axis_m for branch in line.branches}
        self._balises = {balise.id: balise for balise in line.balises}
        self.parallel = line.parallel_tracks
        self._line = line
        self._day: tuple[int, str] | None = None

    def unusable(self, t_ns: int) -> str:
        """Why the line file is not to be used on the day (UTC) of a time; empty when it is.

        Recordings count from their own start: what would be a day of long ago is none.
        """
        if t_ns < FIRST_DAY_NS:
            return ""
        number = t_ns // DAY_NS
        if self._day is None or self._day[0] != number:
            validity = line_validity(self._line, EPOCH + timedelta(days=number))
            self._day = (number, "" if validity.usable else validity.reason)
        return self._day[1]

    def balise(self, name: str) -> Balise | None:
        """Balise by its id."""
        return self._balises.get(name)

    def chainage_m(self, route: str, axis_m: float) -> float | None:
        """Kilometrage of a place."""
        alignment = self.routes.get(route)
        return None if alignment is None else float(alignment.chainage.at(axis_m))

    def axis_at(self, chainage_m: float, near_m: float | None) -> float | None:
        """Place of a kilometrage on the main line; of several the one next to `near_m`, None when that is open."""
        found = self.routes[""].chainage.places(chainage_m)
        if not found or (near_m is None and len(found) > 1):
            return None
        return found[0] if near_m is None else min(found, key=lambda place_m: abs(place_m - near_m))

    def metres_per_chainage(self, axis_m: float) -> float:
        """True metres per metre of kilometrage about a place, at least 1."""
        around = self.routes[""].chainage.at(np.array([axis_m - 10.0, axis_m + 10.0]))
        return max(1.0, 20.0 / max(abs(float(around[1] - around[0])), 1.0))

    def feet(self, route: str, lat_deg: float, lon_deg: float, h_m: float) -> tuple[Foot, ...]:
        """Where a place falls on a route, one per passage near it, nearest first."""
        axis = self.routes[route].axis
        (place,) = axis.to_plane([lat_deg], [lon_deg], [h_m])
        return tuple(Foot(one.axis_m, one.aside_m) for one in candidates(axis, place, FARTHEST_M))

    def foot_near(
        self, route: str, lat_deg: float, lon_deg: float, h_m: float, middle_m: float, reach_m: float
    ) -> Foot | None:
        """Where a place falls on a route within `reach_m` of another; None when it is far aside there."""
        axis = self.routes[route].axis
        places = axis.to_plane([lat_deg], [lon_deg], [h_m])
        ((axis_m, aside_m),) = follow(axis, places, np.array([reach_m]), middle_m).tolist()
        return Foot(axis_m, aside_m) if abs(aside_m) <= FARTHEST_M else None

    def warm_up(self) -> None:
        """Compile the kernels, or load them from their cache."""
        lat_deg, lon_deg, h_m = (float(one) for one in self.routes[""].position(0.0))
        self.foot_near("", lat_deg, lon_deg, h_m, 0.0, FARTHEST_M)

    def has_parallel(self, least_m: float, greatest_m: float) -> bool:
        """Whether another track lies beside some of a stretch of the main line."""
        return any(one.start_axis_m < greatest_m and one.end_axis_m > least_m for one in self.parallel)
