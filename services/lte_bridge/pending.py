"""Records on their way to the disk, bounded by what they take in memory."""

from __future__ import annotations

from dataclasses import dataclass, field

from schemas.bridge import BridgedRecord
from services.lte_bridge.lane import LANES, Lane

OVERHEAD_BYTES = 300
"""What a record takes in memory beside its payload, roughly."""
BULK_SHARE = 0.8
"""Of the room; the rest is for events alone."""


@dataclass(slots=True)
class Pending:
    """Records that wait for the next commit, or for a disk that takes nothing at the moment."""

    limit_bytes: int
    records: list[BridgedRecord] = field(default_factory=list)
    dropped: dict[Lane, int] = field(default_factory=lambda: dict.fromkeys(LANES, 0))
    """For want of room, since they were last taken."""
    _bytes: int = 0

    def add(self, lane: Lane, record: BridgedRecord) -> bool:
        """Take a record in; False when there is no room for it and it is counted as dropped."""
        size = len(record.payload) + OVERHEAD_BYTES
        room = self.limit_bytes if lane == "events" else BULK_SHARE * self.limit_bytes
        if self._bytes + size > room:
            self.dropped[lane] += 1
            return False
        self.records.append(record)
        self._bytes += size
        return True

    @property
    def crowded(self) -> bool:
        """A quarter full: what can wait elsewhere should."""
        return 4 * self._bytes > self.limit_bytes

    def taken(self, count: int, dropped: dict[Lane, int]) -> None:
        """Let go of the first `count` records and of the drops that are durable, or counted, now."""
        del self.records[:count]
        self._bytes = sum(len(record.payload) + OVERHEAD_BYTES for record in self.records)
        for lane, number in dropped.items():
            self.dropped[lane] -= number
