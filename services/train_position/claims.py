"""What a source says of the front end's place, and the places that follow from it at any other time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from services.train_position.instants import Instant

Source = Literal["odometry", "landmark", "gnss", "balise", "restart", "route"]
STREAM: Source = "gnss"
"""The source whose claims follow one another and share their errors."""


class Interval(NamedTuple):
    """Places between two ends [m]."""

    least_m: float
    greatest_m: float

    @property
    def width_m(self) -> float:
        """Distance of the ends; negative when there is nothing between them."""
        return self.greatest_m - self.least_m

    def overlap(self, other: Interval) -> Interval:
        """Places in both; of negative width when there are none.

        >>> Interval(0.0, 10.0).overlap(Interval(8.0, 20.0))
        Interval(least_m=8.0, greatest_m=10.0)
        """
        return Interval(max(self.least_m, other.least_m), min(self.greatest_m, other.greatest_m))

    def hull(self, other: Interval) -> Interval:
        """Everything from one to the other."""
        return Interval(min(self.least_m, other.least_m), max(self.greatest_m, other.greatest_m))

    def clip(self, place_m: float) -> float:
        """Nearest place inside."""
        return min(max(place_m, self.least_m), self.greatest_m)


@dataclass(frozen=True, slots=True)
class Claim:
    """The front end was within `bound_m` of `axis_m` at `t_ns`, says a source."""

    source: Source
    name: str
    """Of the landmark or balise; the source itself otherwise."""
    t_ns: int
    axis_m: float
    bound_m: float
    sigma_m: float
    """One standard deviation, for the estimate."""
    branch: str | None = None
    """Branch on which the place is; None when the source cannot tell."""

    @property
    def words(self) -> str:
        """The claim as people read it."""
        who = "satellites" if self.source == "gnss" else f"{self.source} {self.name}".strip()
        return f"{who}: {self.axis_m:.1f} m ± {self.bound_m:.1f} m"


def offsets_of(axis_m: float, bound_m: float, then: Instant) -> Interval:
    """Interval at an instant as offsets from the sums of displacement, which hold at any time.

    Once the sums have drifted apart an offset's ends may cross; only the places that follow are an interval.
    """
    reach_m = bound_m + then.provisional_m
    return Interval(axis_m - reach_m - then.least_m, axis_m + reach_m - then.greatest_m)


def places_of(offsets: Interval, now: Instant) -> Interval:
    """Places at an instant that follow from offsets."""
    return Interval(
        offsets.least_m + now.least_m - now.provisional_m, offsets.greatest_m + now.greatest_m + now.provisional_m
    )
