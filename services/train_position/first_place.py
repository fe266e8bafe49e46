"""The first place: by satellites, a balise, two landmarks, or one that agrees with where the train was left.

A single curve may be another one that looks like it; two in the right distance are not.
"""

from __future__ import annotations

from services.train_position.claims import Claim, offsets_of, places_of
from services.train_position.held import Held
from services.train_position.instants import Instant


class FirstPlace:
    """Collects claims until they make a place."""

    def __init__(self) -> None:
        """No landmark yet."""
        self._landmark: tuple[Claim, Instant] | None = None

    def take(self, held: Held, claim: Claim, then: Instant) -> list[tuple[Claim, Instant]]:
        """Claims that found the place together, in order of time; none while it takes another landmark."""
        earlier = self._landmark
        if claim.source != "landmark":
            self._landmark = None
            return [(claim, then)]
        self._landmark = (claim, then)
        if earlier is not None and earlier[0].name != claim.name:
            before, at = earlier
            now = held.reach.now or then
            supposed = places_of(offsets_of(before.axis_m, before.bound_m, at), now)
            common = supposed.overlap(places_of(offsets_of(claim.axis_m, claim.bound_m, then), now))
            if common.width_m >= 0.0:
                self._landmark = None
                return [(before, at), (claim, then)]
        held.say("landmark", claim.t_ns, f"{claim.words}: a first place takes another landmark", taken=False)
        held.lost = f"landmark {claim.name} alone may be a twin: waits for another landmark, satellites or a balise"
        return []
