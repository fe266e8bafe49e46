"""The wheel's scale from references at both ends of a known distance.

Two places known within b₁ and b₂, D apart, between which the odometry counted m, with X added by slips, bound
the mean relative error of the wheel between them: ε = (D ± (b₁ + b₂ + X)) / m - 1. Over another stretch it
may differ by a stated share (creep, wear), and no more; pairs that contradict this are forgotten.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from services.train_position.claims import Claim
from services.train_position.instants import Instant, Scale

SHORTEST_M: Final = 300.0
"""Over less, references tell too little of the scale."""
APART_M: Final = 250.0
"""References closer together serve as one end."""
MOST_ENDS: Final = 8
STRAIGHT_SHARE: Final = 0.01
"""To and fro may be so much of the way between the ends at most."""
LARGEST_TOLD: Final = 0.012
"""A scale known less well is of no use to the odometry."""
CREDIBLE: Final = 0.2
"""A scale further from 1 is a mistake in something else."""


class End(NamedTuple):
    """A place known at one instant."""

    axis_m: float
    bound_m: float
    distance_m: float
    way_m: float
    excess_m: float


class WheelScale:
    """What is known of the wheel's relative error beyond what the odometry vouches for."""

    def __init__(self, wander_share: float, turned_share: float) -> None:
        """Know nothing."""
        self.turned = False
        """Wheels were turned, and nothing has told their scale since."""
        self.learned: Scale | None = None
        self._wander = wander_share
        self._turned_share = turned_share
        self._ends: list[End] = []
        self.applied = 1.0
        """Scale that the odometry multiplies by already."""
        self.stretches = 0
        """Pairs of references that have told what is learned."""

    def apply(self, scale: float) -> float:
        """The odometry multiplies by `scale` from now on; returns the ratio to what it did before.

        What was learned is what its distances lacked: so much of it is done. Ends counted in both ways do not mix.
        """
        ratio = scale / self.applied
        if ratio != 1.0:
            self.applied = scale
            self._ends.clear()
            if self.learned is not None:
                self.learned = Scale(*((1.0 + one) / ratio - 1.0 for one in self.learned))
        return ratio

    def told(self) -> tuple[float, float] | None:
        """True over nominal diameter, and its standard deviation; None while it is not known well."""
        if self.learned is None:
            return None
        half = (self.learned.greatest - self.learned.least) / 2.0 + self._wander
        if half > LARGEST_TOLD:
            return None
        return self.applied * (1.0 + (self.learned.least + self.learned.greatest) / 2.0), half / 3.0

    def now(self, share_bound: float) -> Scale:
        """Limits for the step at hand, given what the odometry vouches for."""
        prior = max(share_bound, self._turned_share) if self.turned else share_bound
        if self.learned is None:
            return Scale(-prior, prior)
        least, greatest = self.learned.least - self._wander, self.learned.greatest + self._wander
        if not self.turned:
            least, greatest = max(least, -prior), min(greatest, prior)
        return Scale(least, greatest) if least <= greatest else Scale(-prior, prior)

    def turn(self) -> None:
        """Wheels were turned or changed."""
        self.turned, self.learned, self.stretches = True, None, 0
        self._ends.clear()

    def forget(self) -> None:
        """Drop what was learned, where it has proved wrong."""
        self.learned, self.stretches = None, 0
        self._ends.clear()

    def restart(self) -> None:
        """Begin anew with the ends: the odometry counts from another origin."""
        self._ends.clear()

    def reference(self, claim: Claim, then: Instant, sense: int) -> str:
        """Take a place in; returns what was found to be wrong with the scale so far, or nothing."""
        if sense == 0:
            return ""
        here = End(claim.axis_m, claim.bound_m + then.provisional_m, then.distance_m, then.way_m, then.excess_m)
        found = [one for one in (_scale(end, here, sense) for end in self._ends) if one is not None]
        self._keep(here)
        for one in found:
            self.stretches += 1
            known = self.learned
            if known is None:
                self.learned = one
                continue
            least, greatest = max(known.least, one.least), min(known.greatest, one.greatest)
            if least > greatest + self._wander:
                self.forget()
                return f"the wheel's scale {1.0 + (one.least + one.greatest) / 2.0:.4f} is not what it was"
            # Mean scales of two stretches may differ: their common part may be empty by the wander.
            self.learned = Scale(min(least, greatest), max(least, greatest))
        return ""

    def _keep(self, here: End) -> None:
        if self._ends and abs(here.way_m - self._ends[-1].way_m) < APART_M:
            if here.bound_m < self._ends[-1].bound_m:
                self._ends[-1] = here
            return
        self._ends.append(here)
        del self._ends[:-MOST_ENDS]


def _scale(start: End, end: End, sense: int) -> Scale | None:
    """Limits of the mean relative error between two ends; None where they tell nothing credible."""
    measured_m = sense * (end.distance_m - start.distance_m)
    way_m = end.way_m - start.way_m
    if abs(measured_m) < SHORTEST_M or way_m - abs(measured_m) > STRAIGHT_SHARE * way_m:
        return None
    doubt_m = start.bound_m + end.bound_m + end.excess_m - start.excess_m
    ends = [(end.axis_m - start.axis_m + one) / measured_m - 1.0 for one in (-doubt_m, doubt_m)]
    found = Scale(min(ends), max(ends))
    return found if found.largest <= CREDIBLE else None
