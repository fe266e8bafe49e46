"""How fast a key that was never said before may be said again.

A publisher is found by its readers some time after its first word. What it said until then they
fetch from what it keeps, which is a thousand publications; a backlog would push the oldest out.
"""

from __future__ import annotations

from dataclasses import dataclass, field

FOUND_S = 1.5
"""Readers have found a new publisher by then, also on a busy machine."""
MOST_BEFORE = 400
"""Said on a key until then; well below what a publisher keeps."""
MOST_KEYS = 65_536


@dataclass(slots=True)
class Introductions:
    """Holds back bursts on keys that are new to this process."""

    _found: set[str] = field(default_factory=set)
    _new: dict[str, tuple[float, int]] = field(default_factory=dict)
    """When a key was first said, and how often since."""

    def wait_s(self, key: str, now_s: float) -> float:
        """How long the next publication on a key has to wait [s]; to be asked once for each.

        >>> introductions = Introductions()
        >>> [introductions.wait_s("k", 10.5) for _ in range(MOST_BEFORE)].count(0.0) == MOST_BEFORE
        True
        >>> introductions.wait_s("k", 11.0), introductions.wait_s("k", 11.0)
        (1.0, 0.0)
        """
        if key in self._found:
            return 0.0
        since_s, said = self._new.get(key, (now_s, 0))
        if said < MOST_BEFORE and now_s < since_s + FOUND_S:
            self._new[key] = (since_s, said + 1)
            return 0.0
        self._new.pop(key, None)
        if len(self._found) >= MOST_KEYS:
            self._found.clear()
        self._found.add(key)
        return max(0.0, since_s + FOUND_S - now_s)
