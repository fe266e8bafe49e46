"""Whether a carrier was tracked without a break since it was last seen, told from lock times."""

from __future__ import annotations

from typing import Final

LOST: Final = 1
"""RINEX loss-of-lock indicator, bit 0: the phase does not continue the one before."""
HALF_CYCLE: Final = 2
"""Bit 1: the phase may be off by half a cycle."""


class LockTimes:
    """Remembers for every signal of every satellite how long it had been locked when it was last seen."""

    def __init__(self) -> None:
        """Have seen nothing."""
        self._seen: dict[tuple[str, str], tuple[int, float]] = {}

    def lost(self, satellite: str, signal: str, gps_ms: int, at_least_s: float, below_s: float) -> bool:
        """Whether lock was lost since the last call for this signal.

        The lock now is `at_least_s` old and younger than `below_s`. A lock that held since then
        would be older than the one then by the time that has passed, so what is younger is new.
        Time that does not go forward means that the receiver began anew. A signal never seen
        before counts as lost only where its lock has no age at all, which always means lost.
        """
        before = self._seen.get((satellite, signal))
        self._seen[satellite, signal] = gps_ms, at_least_s
        if before is None or at_least_s == 0.0:
            return at_least_s == 0.0
        then_ms, then_s = before
        passed_s = (gps_ms - then_ms) / 1000.0
        return passed_s <= 0.0 or at_least_s < then_s or below_s <= then_s + passed_s
