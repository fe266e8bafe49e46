"""Whether a source gives as much as it should: epochs of a receiver, samples of a sensor."""

from __future__ import annotations

from collections import deque
from typing import Final

_FEWEST: Final = 5
_SHORTEST_S: Final = 5.0
TOLERANCE: Final = 0.2
"""Share of the rate by which it may differ: clocks drift far less, one epoch lost in a window counts for more."""


class RateWatch:
    """Counts epochs over a window of five seconds, or of five epochs where they are rarer.

    `what` names in the plural what is counted, `tolerance` is the share by which the rate may differ.
    """

    def __init__(self, expected_hz: float, now_s: float, *, what: str = "epochs", tolerance: float = TOLERANCE) -> None:
        """Expect a rate (0: none) from a time on."""
        self._what, self._tolerance = what, tolerance
        self._expected_hz = expected_hz
        self._window_s = max(_SHORTEST_S, _FEWEST / expected_hz) if expected_hz else 0.0
        self._times_s: deque[float] = deque()
        self._since_s = now_s

    def heard(self, now_s: float) -> None:
        """Count an epoch."""
        if self._expected_hz:
            self._times_s.append(now_s)

    def fault(self, now_s: float) -> str:
        """In words what is wrong with the rate; empty when nothing is, or when it is too early to say."""
        if not self._expected_hz or now_s - self._since_s < self._window_s:
            return ""
        while self._times_s and self._times_s[0] <= now_s - self._window_s:
            self._times_s.popleft()
        rate_hz = len(self._times_s) / self._window_s
        # One epoch more or less in the window says nothing.
        slack_hz = max(self._tolerance * self._expected_hz, 1.0 / self._window_s)
        if abs(rate_hz - self._expected_hz) <= slack_hz + 1e-9:
            return ""
        return f"{rate_hz:.3g} {self._what} per second instead of {self._expected_hz:.3g}"
