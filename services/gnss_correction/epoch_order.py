"""Which epochs of a receiver may be solved: time must rise."""

from __future__ import annotations

import math
from typing import Final

from schemas.gnss_time import WEEK_S

RESTART_EPOCHS: Final = 5
"""So many epochs in a row, rising among themselves, are believed against an earlier time: the clock was set back,
or a recording starts over."""
LAST_WEEK: Final = 10_000
"""GPS week that lies more than a century ahead."""


class EpochOrder:
    """Refuses epochs that repeat or step back, until a later run of them proves that time really did."""

    def __init__(self) -> None:
        """Know no epoch yet."""
        self._newest_s = -math.inf
        self._refused_s: list[float] = []
        self.restarts = 0
        """Times that a step back was believed."""

    def refusal(self, gps_week: int, tow_s: float) -> str:
        """Why an epoch may not be solved; empty when it may."""
        if not (0.0 <= tow_s < WEEK_S and 0 <= gps_week < LAST_WEEK):
            return f"absurd epoch time: week {gps_week}, {tow_s} s"
        t_s = gps_week * WEEK_S + tow_s
        step_s = t_s - self._newest_s
        if step_s > 0.0:
            self._newest_s = t_s
            self._refused_s.clear()
            return ""
        if self._refused_s and t_s <= self._refused_s[-1]:
            self._refused_s.clear()
        self._refused_s.append(t_s)
        if len(self._refused_s) >= RESTART_EPOCHS:
            self._refused_s.clear()
            self._newest_s = t_s
            self.restarts += 1
            return ""
        return "epoch repeated" if step_s == 0.0 else f"epoch steps back by {-step_s:.3f} s"
