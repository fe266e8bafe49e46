"""What satellites say of the front end: from all antennas together, or from one antenna's fix.

The antennas' front end (services.gnss_correction) is the end that their lever arms count from, given
by the main line's kilometrage; it serves while the train is certainly on the main line. A single fix is
projected onto every route that is possible; a route from which it is too far aside is none of them.
"""

from __future__ import annotations

import math
from typing import Final

from schemas.gnss import Fix, FrontEnd
from services.train_position.branches import MAIN
from services.train_position.claims import Claim, Interval
from services.train_position.held import Held
from services.train_position.instants import Instant, Sense
from services.train_position.line_places import Foot, LinePlaces

BOUND_SIGMAS: Final = 4.2
"""A bound of satellites is so many standard deviations (services.gnss_correction)."""
LEAST_SIGMA_M: Final = 0.3
CORRELATED_S: Final = 5.0
"""Errors of satellites last about so long: claims closer together count for less in the estimate."""
LARGEST_BOUND_M: Final = 2000.0
"""A wider claim says nothing."""
FAR_M: Final = 2000.0
"""A fix is looked for on the line this far beyond where the train may be first, then everywhere."""
ASIDE_FIXES: Final = 3
"""A route is excluded once so many fixes in a row are aside from it."""


class Satellites:
    """Makes claims of what satellites say."""

    def __init__(self) -> None:
        """Nothing heard."""
        self._newest_ns: int | None = None
        self._aside: dict[str, int] = {}

    def front_end(self, held: Held, message: FrontEnd, then: Instant) -> Claim | str:
        """Claim of all antennas together; a reason in words where there is none."""
        line = held.line
        if line is None:
            return "no line file: a kilometrage has no place"
        if message.chainage_m is None or message.chainage_bound_m is None:
            return message.reason or "the antennas give no front end"
        if abs(message.chainage_m) > 1e7 or message.chainage_bound_m > LARGEST_BOUND_M:  # noqa: PLR2004 - metres beyond any line
            return f"a front end at {message.chainage_m:.0f} m ± {message.chainage_bound_m:.0f} m"
        places = held.places_at(then)
        if places is not None and held.branch(places) != MAIN:
            return "kilometrage of the main line, while the train may be on a branch"
        near_m = None if places is None else (places.least_m + places.greatest_m) / 2.0
        axis_m = line.axis_at(message.chainage_m, near_m)
        if axis_m is None:
            return f"no single place has the kilometrage {message.chainage_m:.0f} m"
        bound_m = message.chainage_bound_m * line.metres_per_chainage(axis_m)
        return self._claim(held, axis_m, bound_m, then)

    def faces(self, held: Held, message: FrontEnd) -> Sense:
        """Sense of the vehicle by the antennas' order; 0 where they do not tell, or contradict each other."""
        if held.line is None or message.facing is None or message.agreement != "agree" or message.chainage_m is None:
            return 0
        rising = _kilometrage_rises(held.line, message.chainage_m)
        return 1 if (message.facing == "up") == rising else -1

    def fix(self, held: Held, device: str, message: Fix, then: Instant) -> Claim | str:
        """Claim of one antenna's fix; a reason in words where there is none."""
        antenna = held.config.antennas.get(device)
        if held.line is None or antenna is None:
            return f"no lever arm for {device}" if antenna is None else "no line file: a fix has no place"
        lat_deg, lon_deg, bound_m = message.lat_deg, message.lon_deg, message.bound_m
        if message.status != "fix" or lat_deg is None or lon_deg is None or bound_m is None:
            return message.reason or "no fix with a bound"
        if bound_m > LARGEST_BOUND_M or abs(lat_deg) > 90.0 or abs(lon_deg) > 360.0:  # noqa: PLR2004 - angles on Earth
            return f"a fix at {lat_deg:.3f}, {lon_deg:.3f} ± {bound_m:.0f} m"
        found = self._feet(held, lat_deg, lon_deg, message.h_m or 0.0, bound_m, then)
        if isinstance(found, str):
            return found
        sense = held.sense_at(then.t_ns)
        axis_m = (found.least_m + found.greatest_m) / 2.0 + sense * antenna.behind_m
        unknown_m = antenna.behind_m if sense == 0 else 0.0
        return self._claim(held, axis_m, found.width_m / 2.0 + bound_m + unknown_m, then)

    def along_mps(self, held: Held, message: Fix, then: Instant) -> float | None:
        """Speed of a fix along the line, towards rising `axis_m`; None where it cannot be told."""
        if message.speed_along_mps is not None:
            return message.speed_along_mps
        places, line = held.places_at(then), held.line
        if (
            message.status != "fix"
            or message.ve_mps is None
            or message.vn_mps is None
            or places is None
            or line is None
        ):
            return None
        heading_rad = float(line.routes[MAIN].heading_rad((places.least_m + places.greatest_m) / 2.0))
        return message.ve_mps * math.sin(heading_rad) + message.vn_mps * math.cos(heading_rad)

    def _feet(
        self, held: Held, lat_deg: float, lon_deg: float, h_m: float, bound_m: float, then: Instant
    ) -> Interval | str:
        """Hull of the antenna's places on every route possible, near to where the train may be."""
        places = held.places_at(then)
        line = held.line
        if line is None:
            return "no line file"
        allowed_m = bound_m + held.config.beside_m
        hull: Interval | None = None
        aside: list[str] = []
        routes = held.branches.possible if places is None else held.branches.candidates(held.span(places))
        for route in sorted(routes):
            chosen = self._near(line, route, (lat_deg, lon_deg, h_m), places, allowed_m)
            if not chosen:
                aside.append(route)
                continue
            for one in chosen:
                here = Interval(one.axis_m, one.axis_m)
                hull = here if hull is None else hull.hull(here)
        if hull is None:
            return "the fix is aside from every route of the line"
        if hull.width_m > LARGEST_BOUND_M:
            return "the fix may belong to places of the line far from each other"
        self._exclude(held, aside)
        return hull

    def _near(
        self, line: LinePlaces, route: str, place: tuple[float, float, float], places: Interval | None, allowed_m: float
    ) -> list[Foot]:
        """Feet of a fix on a route: the one next to where the train may be, else all; none when it is aside."""
        if places is not None:
            middle_m, reach_m = (places.least_m + places.greatest_m) / 2.0, places.width_m / 2.0 + FAR_M
            near = line.foot_near(route, *place, middle_m, reach_m)
            if near is not None and abs(near.aside_m) <= allowed_m:
                return [near]
        feet = [one for one in line.feet(route, *place) if abs(one.aside_m) <= allowed_m]
        if places is None or not feet:
            return feet
        return [min(feet, key=lambda one: abs(one.axis_m - middle_m))]

    def _exclude(self, held: Held, aside: list[str]) -> None:
        for route in list(self._aside):
            if route not in aside:
                del self._aside[route]
        for route in aside:
            self._aside[route] = self._aside.get(route, 0) + 1
            if self._aside[route] >= ASIDE_FIXES:
                held.branches.exclude(route)

    def _claim(self, held: Held, end_m: float, bound_m: float, then: Instant) -> Claim:
        """Claim of the front end, from the place of the sensors' end."""
        makeup, sense = held.makeup_at(then.t_ns), held.sense_at(then.t_ns)
        axis_m = end_m + sense * makeup.front_m
        unknown_m = makeup.doubt_m + (abs(makeup.front_m) if sense == 0 else 0.0)
        added_m = held.config.line_accuracy_m + unknown_m + held.clock_bound_m(then)
        since_s = CORRELATED_S if self._newest_ns is None else abs(then.t_ns - self._newest_ns) / 1e9
        self._newest_ns = then.t_ns
        # Claims of one stretch of time share their errors: together they weigh as much as one.
        weight = max(1.0, CORRELATED_S / max(since_s, 0.05)) ** 0.5
        sigma_m = max(bound_m / BOUND_SIGMAS, LEAST_SIGMA_M) * weight
        return Claim("gnss", "gnss", then.t_ns, axis_m, bound_m + added_m, sigma_m)


def _kilometrage_rises(line: LinePlaces, chainage_m: float) -> bool:
    """Whether kilometrage rises with `axis_m` there."""
    places = line.routes[MAIN].chainage.places(chainage_m)
    place_m = places[0] if places else 0.0
    before_m, after_m = line.chainage_m(MAIN, place_m - 1.0), line.chainage_m(MAIN, place_m + 1.0)
    return before_m is None or after_m is None or after_m >= before_m
