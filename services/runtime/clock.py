"""Time as services see it: live, or moved by hand in tests and offline replay."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Two clocks in one: the calendar for stamps, and one that never steps for intervals."""

    def now_ns(self) -> int:
        """UTC in Unix nanoseconds. May step, also backwards, when the host's clock is set."""

    def monotonic_s(self) -> float:
        """Seconds since an arbitrary start; never steps."""


class LiveClock:
    """The host's clocks."""

    def now_ns(self) -> int:
        """UTC in Unix nanoseconds."""
        return time.time_ns()

    def monotonic_s(self) -> float:
        """Seconds since the host's start."""
        return time.monotonic()


class LoopTime(Protocol):
    """Whatever can tell a loop's time; asyncio's event loops do."""

    def time(self) -> float:
        """Seconds since an arbitrary start."""


class ManualClock:
    """A clock that stands still until its (virtual) event loop moves.

    The calendar is `start_ns` plus what the loop has moved, plus every `step_ns` so far.
    """

    def __init__(self, loop: LoopTime, start_ns: int = 0) -> None:
        """Read 0 s and `start_ns` now."""
        self._loop = loop
        self._origin_s = loop.time()
        self._start_ns = start_ns

    def now_ns(self) -> int:
        """UTC in Unix nanoseconds."""
        return self._start_ns + round(self.monotonic_s() * 1e9)

    def monotonic_s(self) -> float:
        """Seconds since this clock was made."""
        return self._loop.time() - self._origin_s

    def step(self, step_ns: int) -> None:
        """Set the calendar forward, or back, as an operator or a time server would."""
        self._start_ns += step_ns
