"""When a spool will be full, at the rate of the last hour."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

WINDOW_S = 3600.0
STEP_S = 30.0
LEAST_S = 60.0
"""Less tells nothing."""


@dataclass(slots=True)
class Filling:
    """Remembers how full the spool was."""

    _seen: deque[tuple[float, int]] = field(default_factory=deque)

    def note(self, now_s: float, held_bytes: int) -> None:
        """Take note of what the spool holds; monotonic time."""
        if not self._seen or now_s - self._seen[-1][0] >= STEP_S:
            self._seen.append((now_s, held_bytes))
        while now_s - self._seen[0][0] > WINDOW_S:
            self._seen.popleft()

    def full_in_s(self, now_s: float, held_bytes: int, cap_bytes: int) -> float | None:
        """Time until the cap is reached [s]; None while it does not fill, or nothing is known yet.

        >>> filling = Filling()
        >>> filling.note(0.0, 1000)
        >>> filling.full_in_s(100.0, 2000, 5000)
        300.0
        """
        if not self._seen:
            return None
        since_s, before = self._seen[0]
        grown, passed_s = held_bytes - before, now_s - since_s
        if passed_s < LEAST_S or grown <= 0:
            return None
        return max(0, cap_bytes - held_bytes) * passed_s / grown
