"""Gaps, repetitions, restarts and false twins, from the sequence numbers of one source on one key."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum


class Mark(Enum):
    """What a sequence number says of its message."""

    FIRST = "first"
    NEXT = "next"
    GAP = "gap"
    DUPLICATE = "duplicate"
    RESTART = "restart"
    TWIN = "twin"
    """A boot id that had been replaced speaks again: two senders share one identity."""


@dataclass(slots=True)
class SequenceTracker:
    """Follows one source on one key.

    A number at or below the newest of the same start is a duplicate (or was overtaken) and is
    not to be handed on. The first message seen may have any number: a reader may join late.
    After a restart numbers count from 0; what the new start sent before is missing.
    """

    boot_id: str = ""
    newest: int = -1
    received: int = 0
    missing: int = 0
    duplicated: int = 0
    restarts: int = 0
    twins: int = 0
    past_boots: dict[str, int] = field(default_factory=dict)
    """Newest number of each start that was replaced (the last 16)."""

    def take(self, boot_id: str, sequence: int) -> Mark:
        """Note one arrival and say what it is."""
        if boot_id != self.boot_id:
            return self._take_other_boot(boot_id, sequence)
        skipped = sequence - self.newest - 1
        if skipped == 0:
            self.newest = sequence
            self.received += 1
            return Mark.NEXT
        if skipped < 0:
            self.duplicated += 1
            return Mark.DUPLICATE
        self.newest = sequence
        self.received += 1
        self.missing += skipped
        return Mark.GAP

    def _take_other_boot(self, boot_id: str, sequence: int) -> Mark:
        if not self.boot_id:
            self.boot_id, self.newest = boot_id, sequence
            self.received += 1
            return Mark.FIRST
        known = self.past_boots.pop(boot_id, None)
        if known is not None and sequence <= known:
            self.past_boots[boot_id] = known
            self.duplicated += 1
            return Mark.DUPLICATE
        self.past_boots[self.boot_id] = self.newest
        while len(self.past_boots) > 16:  # noqa: PLR2004 - as the docstring says
            del self.past_boots[next(iter(self.past_boots))]
        self.boot_id, self.newest = boot_id, sequence
        self.received += 1
        if known is not None:
            self.twins += 1
            return Mark.TWIN
        self.restarts += 1
        self.missing += sequence
        return Mark.RESTART
