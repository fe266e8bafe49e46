"""The place of a run in a file, where no position service holds one: dead reckoning from match to match."""

from __future__ import annotations

from dataclasses import replace

from services.landmark_matching.anchor import Anchor
from services.landmark_matching.curve_shape import direction_sign
from services.landmark_matching.matcher import Match
from services.landmark_matching.reading import Reading


class OwnPosition:
    """Holds the newest anchor."""

    def __init__(self, start: Anchor) -> None:
        """Begin at a known place."""
        self.anchor = start

    def take(self, match: Match, reading: Reading) -> None:
        """Reset by an accepted match; the slips until now count as excess that is already explained."""
        if not match.accepted:
            return
        u_m = direction_sign(self.anchor.direction) * match.axis_m
        self.anchor = replace(
            self.anchor,
            u_m=u_m,
            distance_m=match.distance_m,
            ahead_m=match.bound_m,
            behind_m=match.bound_m,
            excess_m=reading.excess_m,
        )
