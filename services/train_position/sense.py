"""Which way the vehicle stands on the line: whether its forward axis points towards rising `axis_m`.

Told by two places and the signed distance rolled between them: rising by as much, or falling by as much,
never both once the distance is larger than the places' bounds.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from services.train_position.instants import Sense

MOST_ENDS: Final = 12
SHARE: Final = 0.05
"""Larger than any wheel's error."""


class Sighting(NamedTuple):
    """A place, and the odometry's distance there."""

    axis_m: float
    bound_m: float
    distance_m: float


class SenseFinder:
    """Collects places until they tell."""

    def __init__(self) -> None:
        """No place yet."""
        self._seen: list[Sighting] = []

    def forget(self) -> None:
        """The odometry counts from another origin, or the vehicle was moved unseen."""
        self._seen.clear()

    def take(self, axis_m: float, bound_m: float, distance_m: float) -> Sense:
        """Sense that follows, or 0 while both are possible (or neither: somebody is wrong)."""
        here = Sighting(axis_m, bound_m, distance_m)
        found = {one for one in (_sense(earlier, here) for earlier in self._seen) if one != 0}
        if not self._seen or abs(self._seen[-1].distance_m - distance_m) > bound_m:
            self._seen.append(here)
            del self._seen[:-MOST_ENDS]
        return found.pop() if len(found) == 1 else 0


def _sense(start: Sighting, end: Sighting) -> Sense:
    rolled_m, gone_m = end.distance_m - start.distance_m, end.axis_m - start.axis_m
    slack_m = start.bound_m + end.bound_m + SHARE * abs(rolled_m)
    rising, falling = abs(gone_m - rolled_m) <= slack_m, abs(gone_m + rolled_m) <= slack_m
    if rising == falling:
        return 0
    return 1 if rising else -1
