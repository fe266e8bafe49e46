"""What was known when the odometry was last believed, and the way that it says it has counted since then.

While it is silent, lost or not believed physics bounds the way. Once it is believed again the way that it counted
meanwhile is a claim beside what is held by then, unless there is a reason not to take it at its word.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from schemas.motion import Odometry
from services.train_position.claims import Claim, places_of
from services.train_position.held import Held
from services.train_position.instants import Instant, Physics
from services.train_position.reach import Reach

LEAST_SIGMA_M: Final = 0.1


class Carried(NamedTuple):
    """Where the odometry says that it has carried the train, and the likeliest place of that."""

    claim: Claim
    middle_m: float


class Interruption:
    """One of them, from the instant at which the odometry went."""

    def __init__(self, held: Held, instant: Instant, *, takes_word: bool) -> None:
        """`takes_word`: what it counts meanwhile can be believed later."""
        self._held = held
        self._offsets = held.belief.offsets() if takes_word else None
        self._estimate_m = None if held.estimate is None else held.estimate.axis_m
        self._changes = held.changes
        self._origin = held.origin
        physics = Physics(held.config.most_speed_mps, held.config.most_acceleration_mps2)
        self._alone = Reach(physics, held.reach.sense)
        self._alone.begin(instant, held.reach.share)
        self._start = instant

    def begin_anew(self, odometry: Odometry) -> None:
        """Count from another origin's first message on; physics bounds what lies before it."""
        self._origin = odometry.origin
        self._alone.gap(odometry)

    def follow(self, odometry: Odometry) -> None:
        """Count a message that is not believed for now; never again when it breaks off."""
        if odometry.slip != 0 or odometry.status == "lost" or not self._advance(odometry):
            self._offsets = None

    def carried(self, odometry: Odometry) -> Carried | None:
        """Claim with the message at which the odometry is believed again; None where it tells nothing."""
        if self._offsets is None or not self._advance(odometry):
            return None
        now = self._alone.now or self._start
        places = places_of(self._offsets, now)
        middle_m = places.clip((self._estimate_m or 0.0) + now.likeliest_m - self._start.likeliest_m)
        half_m, centre_m = max(places.width_m / 2.0, 0.0), (places.least_m + places.greatest_m) / 2.0
        sigma_m = max(half_m / 3.0, LEAST_SIGMA_M)
        return Carried(Claim("odometry", "odometry", odometry.t_ns, centre_m, half_m, sigma_m), middle_m)

    def _advance(self, odometry: Odometry) -> bool:
        now = self._alone.now or self._start
        counts_on = odometry.origin == self._origin and self._changes == self._held.changes
        if not counts_on or self._alone.refusal(odometry):
            return False
        advance(self._held, self._alone, odometry, now)
        return True


def advance(held: Held, reach: Reach, odometry: Odometry, now: Instant) -> None:
    """Go one message on in `reach`, by the wheel's scale as it is known."""
    ratio = held.scale.apply(odometry.wheel_scale or 1.0)
    if ratio != 1.0 and held.estimate is not None:
        held.estimate.scale = (1.0 + held.estimate.scale) / ratio - 1.0
    share = max(reach.share, odometry.share_bound)
    reach.step(odometry, held.scale.now(share), max(now.way_m - held.narrowed_way_m, 0.0))
