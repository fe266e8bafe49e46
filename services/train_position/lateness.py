"""How late the odometry comes: its stamps against the clock of the host that hears it.

Delays that are always there (averaging, sensors, the bus) are usual; what is beyond them has piled up somewhere, and
the train has run on meanwhile. Two clocks are compared by their differences alone, so that neither needs to be right.
"""

from __future__ import annotations

from typing import Final

WINDOW_S: Final = 600.0
"""The usual lag is the smallest of so long: a clock that drifts by 100 ppm moves it by 60 ms."""


class Lateness:
    """Lag of the odometry beyond what is usual."""

    def __init__(self) -> None:
        """Nothing heard yet."""
        self._usual_s: float | None = None
        self._lately_s: float | None = None
        self._since_s = 0.0

    def forget(self) -> None:
        """One of the clocks was set."""
        self._usual_s = self._lately_s = None

    def of(self, t_ns: int, heard_s: float) -> float:
        """Seconds by which a message stamped `t_ns` came later than usual, at `heard_s` of a clock that never steps."""
        lag_s = heard_s - t_ns / 1e9
        if self._usual_s is None or self._lately_s is None:
            self._usual_s = self._lately_s = lag_s
            self._since_s = heard_s
        self._lately_s = min(self._lately_s, lag_s)
        if heard_s - self._since_s > WINDOW_S:
            self._usual_s, self._lately_s, self._since_s = self._lately_s, lag_s, heard_s
        self._usual_s = min(self._usual_s, lag_s)
        return lag_s - self._usual_s
