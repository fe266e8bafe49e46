"""One front end from several antennas, and whether the antennas agree.

An antenna stands a known length behind the train's front end (its lever arm along the train). On a
known line every fix gives a chainage; the front end lies ahead of it by that length, in the direction
in which the front faces. Two antennas tell that direction, and contradict each other when their
distance is not what the train says: then one of them is wrong and the front end may be at either.
Without a line only the distance is compared, a train in a curve being shorter than it is long.

Estimates are not averaged: antennas of one train share their errors (the same reflections, the same
ephemerides), so that the mean would promise more than it holds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

from schemas.gnss import Fix, FrontEnd
from services.numerics.geodesy import ecef_from_geodetic

Facing = Literal["up", "down"]
OLDEST_FIX_S: Final = 1.0
"""An older fix of another antenna says nothing about now."""
DRIFT_MPS: Final = 1.5
"""A fix moved on by its own speed is worse by this much a second: acceleration, and the speed's error."""
TIGHTEST_RADIUS_M: Final = 100.0
"""No train of a main line or a metro stands in a tighter curve."""


class Antenna(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where an antenna stands on its train."""

    behind_front_m: Annotated[float, Meta(ge=0.0, le=1000.0)]
    """Along the train, from the front end to the antenna."""


@dataclass(frozen=True, slots=True)
class _Sight:
    """One antenna's fix, moved to the common time."""

    device: str
    fix: Fix
    behind_front_m: float
    chainage_m: float | None
    bound_m: float
    """Of the chainage where there is one, else horizontal."""


class FrontEndFinder:
    """Follows the antennas of one train."""

    def __init__(self, antennas: dict[str, Antenna], facing: Facing | None = None) -> None:
        """Know the antennas by device; `facing` only where one antenna must do."""
        self._antennas = antennas
        self._configured = facing
        self._found: Facing | None = None
        self._newest: dict[str, Fix] = {}

    def take(self, device: str, fix: Fix) -> FrontEnd | None:
        """Front end at the time of this fix; None for a device without lever arm."""
        if device not in self._antennas:
            return None
        self._newest[device] = fix
        sights = [sight for sight in (self._sight(name, fix.t_ns) for name in self._newest) if sight is not None]
        if not sights:
            return _message(fix.t_ns, (), "unknown", "no antenna has a fix with a bound")
        agreement, gap_m, limit_m, text = self._compare(sights)
        if any(sight.chainage_m is None for sight in sights):
            return _message(fix.t_ns, sights, agreement, text, gap_m, limit_m)
        return self._place(fix.t_ns, sights, agreement, gap_m, limit_m, text)

    def _sight(self, device: str, t_ns: int) -> _Sight | None:
        fix = self._newest[device]
        age_s = (t_ns - fix.t_ns) / 1e9
        if fix.status == "none" or not 0.0 <= age_s <= OLDEST_FIX_S or fix.bound_m is None:
            return None
        chainage_m, bound_m = fix.chainage_m, fix.chainage_bound_m
        if chainage_m is not None and bound_m is not None:
            chainage_m += (fix.speed_along_mps or 0.0) * age_s
        else:
            chainage_m, bound_m = None, fix.bound_m
        worse_m = (DRIFT_MPS if fix.speed_along_mps is not None else _speed_mps(fix)) * age_s
        return _Sight(device, fix, self._antennas[device].behind_front_m, chainage_m, bound_m + worse_m)

    def _compare(self, sights: list[_Sight]) -> tuple[Literal["agree", "disagree", "unknown"], float, float, str]:
        """Agreement of the pair of antennas that contradict each other most."""
        worst: tuple[float, float, float, str] | None = None
        for i, one in enumerate(sights):
            for other in sights[i + 1 :]:
                apart_m = abs(one.behind_front_m - other.behind_front_m)
                limit_m = one.bound_m + other.bound_m
                if one.chainage_m is not None and other.chainage_m is not None:
                    seen_m = abs(one.chainage_m - other.chainage_m)
                    gap_m = abs(seen_m - apart_m)
                else:
                    seen_m = _distance_m(one.fix, other.fix)
                    gap_m = max(seen_m - apart_m, _shortest_m(apart_m) - seen_m, 0.0)
                text = f"{one.device} and {other.device} are {seen_m:.1f} m apart, {apart_m:.1f} m on the train"
                if worst is None or gap_m - limit_m > worst[0]:
                    worst = (gap_m - limit_m, gap_m, limit_m, text)
        if worst is None:
            return "unknown", 0.0, 0.0, f"{sights[0].device} alone has a fix with a bound"
        over_m, gap_m, limit_m, text = worst
        if over_m > 0.0:
            return "disagree", gap_m, limit_m, f"{text}; their bounds allow {limit_m:.1f} m of difference"
        return "agree", gap_m, limit_m, text

    def _place(
        self,
        t_ns: int,
        sights: list[_Sight],
        agreement: Literal["agree", "disagree", "unknown"],
        gap_m: float,
        limit_m: float,
        text: str,
    ) -> FrontEnd:
        if agreement == "agree":
            self._found = _facing_of(sights) or self._found
        facing = self._found or self._configured
        if facing is None:
            said = f"{text}; the direction of the front is not known"
            return _message(t_ns, sights, agreement, said, gap_m, limit_m)
        sign = 1.0 if facing == "up" else -1.0
        fronts = [((sight.chainage_m or 0.0) + sign * sight.behind_front_m, sight.bound_m) for sight in sights]
        if agreement == "disagree":
            low_m = min(front_m - bound_m for front_m, bound_m in fronts)
            high_m = max(front_m + bound_m for front_m, bound_m in fronts)
            front_m, bound_m = (low_m + high_m) / 2.0, (high_m - low_m) / 2.0
        else:
            front_m, bound_m = min(fronts, key=lambda front: front[1])
        found = _message(t_ns, sights, agreement, text, gap_m, limit_m)
        return msgspec.structs.replace(found, chainage_m=front_m, chainage_bound_m=bound_m, facing=facing)


def _facing_of(sights: list[_Sight]) -> Facing | None:
    """Direction of the front by the two antennas that stand furthest apart; None while bounds leave it open."""
    ahead = min(sights, key=lambda sight: sight.behind_front_m)
    behind = max(sights, key=lambda sight: sight.behind_front_m)
    difference_m = (ahead.chainage_m or 0.0) - (behind.chainage_m or 0.0)
    if abs(difference_m) <= ahead.bound_m + behind.bound_m:
        return None
    return "up" if difference_m > 0.0 else "down"


def _message(
    t_ns: int,
    sights: list[_Sight] | tuple[()],
    agreement: Literal["agree", "disagree", "unknown"],
    text: str,
    gap_m: float | None = None,
    limit_m: float | None = None,
) -> FrontEnd:
    compared = len(sights) > 1
    return FrontEnd(
        t_ns=t_ns,
        devices=tuple(sight.device for sight in sights),
        agreement=agreement,
        reason=text,
        difference_m=gap_m if compared else None,
        allowed_m=limit_m if compared else None,
    )


def _speed_mps(fix: Fix) -> float:
    return math.hypot(fix.ve_mps or 0.0, fix.vn_mps or 0.0) + DRIFT_MPS


def _shortest_m(length_m: float) -> float:
    """Chord of an arc of this length in the tightest curve.

    >>> round(_shortest_m(100.0), 1)
    95.9
    """
    turned_rad = min(length_m / TIGHTEST_RADIUS_M, math.pi)
    return 2.0 * TIGHTEST_RADIUS_M * math.sin(turned_rad / 2.0)


def _distance_m(one: Fix, other: Fix) -> float:
    """Horizontal distance of two fixes that are near each other [m]."""
    h_m = one.h_m or 0.0
    places = [
        ecef_from_geodetic(math.radians(fix.lat_deg or 0.0), math.radians(fix.lon_deg or 0.0), h_m)
        for fix in (one, other)
    ]
    return math.dist(*places)
