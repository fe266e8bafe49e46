"""Where a train was at a time, between the positions that it has told."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from dataclasses import dataclass, replace
from typing import Final

from schemas.line import Direction
from schemas.position import TrainPosition
from services.radio_probe.journeys import Journeys

NS: Final = 10**9
KEPT: Final = 1200
"""Positions that are remembered: two minutes of them."""
SET_BACK_NS: Final = 60 * NS
"""Positions that are so much older than the last: the train's clock was set back."""
CHAIN_SLACK: Final = 0.02
"""By which kilometrage and length may differ between two positions; beyond it a chain is broken between them."""


@dataclass(frozen=True, slots=True)
class Spot:
    """A place at a time."""

    t_ns: int
    axis_m: float
    chainage_m: float | None
    bound_m: float
    """Error of the place that is vouched for, either side."""
    branch: str
    direction: Direction | None
    """Of travel."""
    speed_mps: float | None
    pass_id: str


@dataclass(frozen=True, slots=True)
class NoPlace:
    """Why there is no place."""

    t_ns: int
    reason: str


class Timeline:
    """The newest positions of one train."""

    def __init__(self, train: str, largest_gap_s: float, largest_bound_m: float) -> None:
        """Begin with none."""
        self._told: deque[Spot | NoPlace] = deque(maxlen=KEPT)
        self._journeys = Journeys(train)
        self._gap_ns = round(largest_gap_s * NS)
        self._bound_m = largest_bound_m

    def take(self, position: TrainPosition) -> None:
        """Remember a position; one that is no newer than the last is left out."""
        if self._told and position.t_ns <= self._told[-1].t_ns:
            if position.t_ns > self._told[-1].t_ns - SET_BACK_NS:
                return
            self._told.clear()
        self._told.append(self._seen(position))

    def _seen(self, position: TrainPosition) -> Spot | NoPlace:
        ahead_m, behind_m = position.bound_ahead_m, position.bound_behind_m
        if position.status == "lost" or position.axis_m is None or ahead_m is None or behind_m is None:
            return NoPlace(position.t_ns, f"the position is {position.status}: {position.reason}")
        self._journeys.take(position)
        return Spot(
            t_ns=position.t_ns,
            axis_m=position.axis_m,
            chainage_m=position.chainage_m,
            bound_m=max(ahead_m, behind_m),
            branch=position.branch or "",
            direction=self._journeys.direction,
            speed_mps=None if position.speed_mps is None else abs(position.speed_mps),
            pass_id=self._journeys.pass_id,
        )

    def at(self, t_ns: int) -> Spot | NoPlace | None:
        """Where the train was; None while that is not known yet."""
        told = self._told
        if not told or t_ns > told[-1].t_ns:
            return None
        number = bisect_left(told, t_ns, key=lambda one: one.t_ns)
        after = told[number]
        if after.t_ns == t_ns:
            return self._sure(after)
        if number == 0:
            return NoPlace(t_ns, "no position so early")
        return self._sure(self._between(told[number - 1], after, t_ns))

    def _between(self, before: Spot | NoPlace, after: Spot | NoPlace, t_ns: int) -> Spot | NoPlace:
        if isinstance(before, NoPlace) or isinstance(after, NoPlace):
            return before if isinstance(before, NoPlace) else after
        if after.t_ns - before.t_ns > self._gap_ns:
            return NoPlace(t_ns, f"no position for {(after.t_ns - before.t_ns) / NS:.1f} s")
        share = (t_ns - before.t_ns) / (after.t_ns - before.t_ns)
        nearer = before if share < 0.5 else after  # noqa: PLR2004 - the middle
        if before.pass_id != after.pass_id:
            # Between two passes the front end is now the one end of the train, now the other.
            return replace(nearer, t_ns=t_ns)
        step_m = after.axis_m - before.axis_m
        axis_m = before.axis_m + share * step_m
        fastest_mps = max(before.speed_mps or 0.0, after.speed_mps or 0.0)
        # More than the train can have gone: the position was corrected, and who knows when it began to be wrong.
        leap_m = max(abs(step_m) - fastest_mps * (after.t_ns - before.t_ns) / NS, 0.0)
        return replace(
            nearer,
            t_ns=t_ns,
            axis_m=axis_m,
            chainage_m=_chainage_m(before, after, nearer, axis_m, share),
            bound_m=max(before.bound_m, after.bound_m) + leap_m,
        )

    def _sure(self, place: Spot | NoPlace) -> Spot | NoPlace:
        if isinstance(place, Spot) and place.bound_m > self._bound_m:
            return NoPlace(place.t_ns, f"the position is only sure to {place.bound_m:.0f} m")
        return place


def _chainage_m(before: Spot, after: Spot, nearer: Spot, axis_m: float, share: float) -> float | None:
    """Kilometrage between two positions; metre by metre from the nearer one where a chain is broken between them."""
    if before.chainage_m is None or after.chainage_m is None or nearer.chainage_m is None:
        return None
    step_m, chain_m = after.axis_m - before.axis_m, after.chainage_m - before.chainage_m
    if abs(abs(chain_m) - abs(step_m)) <= CHAIN_SLACK * abs(step_m) + 1.0:
        return before.chainage_m + share * chain_m
    return nearer.chainage_m + (axis_m - nearer.axis_m)
