"""How a key that this process never said before is said again.

A publisher is found by its readers some time after its first word. What it said before they fetch
from it, which fails when it is killed meanwhile; and a reader that has heard later words takes
earlier ones, said again by the next process, for repetitions. Hence one word first, and no
second before the readers have found who said it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from schemas.bridge import BridgedRecord

FOUND_S = 1.5
"""Readers have found a new publisher by then, also on a busy machine."""
MOST_KEYS = 65_536


@dataclass(slots=True)
class Introductions:
    """Holds back what follows the first word on a key."""

    _first_s: dict[str, float] = field(default_factory=dict)
    """When each key was first said."""

    def order(self, records: Sequence[BridgedRecord]) -> list[BridgedRecord]:
        """Records with the first words of new keys before all others; the order on each key stays."""
        firsts: dict[str, int] = {}
        for index, record in enumerate(records):
            if record.key not in self._first_s:
                firsts.setdefault(record.key, index)
        if not firsts:
            return list(records)
        early = set(firsts.values())
        return [records[i] for i in sorted(early)] + [one for i, one in enumerate(records) if i not in early]

    def wait_s(self, key: str, now_s: float) -> float:
        """How long the next word on a key has to wait [s]; monotonic time."""
        since_s = self._first_s.get(key)
        return 0.0 if since_s is None else max(0.0, since_s + FOUND_S - now_s)

    def said(self, key: str, now_s: float) -> None:
        """Take note of a word that has been said."""
        if len(self._first_s) >= MOST_KEYS:
            self._first_s.clear()
        self._first_s.setdefault(key, now_s)
