"""A person's word that a stretch has a new normal: what counts as learned there, and how it is taken back."""

from __future__ import annotations

from collections.abc import Iterable

from schemas.radio import RadioAcceptance
from services.radio_anomaly.baseline import Mask
from services.radio_anomaly.passes import day_of


class Acceptances:
    """Words in force and words taken back; all are kept, so that the log is whole."""

    def __init__(self, log: Iterable[RadioAcceptance] = ()) -> None:
        """As kept before."""
        self.log: list[RadioAcceptance] = list(log)

    def take(self, word: RadioAcceptance) -> bool:
        """Add to the log; False for one that is there already (a message heard twice)."""
        if word in self.log:
            return False
        self.log.append(word)
        return True

    def in_force(self, radio: str, channel: str) -> list[RadioAcceptance]:
        """Words about a radio and channel, the last one on each identity counting."""
        last = {word.acceptance_id: word for word in self.log}
        return [
            word for word in last.values() if not word.revoked and word.radio == radio and word.channel in ("", channel)
        ]

    def mask(self, radio: str, channel: str, section_m: float) -> Mask | None:
        """What of the sums counts; None: all that was learned.

        Sums are by day: the day of `since_ns` itself counts to the new normal.
        """
        words = self.in_force(radio, channel)
        if not words:
            return None

        def status(direction: str, section: int, day: str) -> str | None:
            found: str | None = "learned"
            for word in words:
                inside = word.section_start_m < (section + 1) * section_m and word.section_end_m > section * section_m
                if inside and (word.direction is None or word.direction == direction):
                    found = "accepted" if day >= day_of(word.since_ns) else None
                    if found is None:
                        return None
            return found

        return status
