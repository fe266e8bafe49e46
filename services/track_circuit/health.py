"""Condition of a circuit over days: level, leakage, drift of the taps, error vector, failed checks."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final

import numpy as np

HOUR_S: Final = 3_600.0
DAY_S: Final = 86_400.0
KEPT_HOURS: Final = 14 * 24
FEWEST_HOURS: Final = 12
"""A trend by day is not told from less."""
SMOOTHING: Final = 0.05
"""Share of the newest value in running means."""
RECENT: Final = 50
"""Telegrams among which failed ones are counted."""
FAILING_SHARE: Final = 0.2
SINKING_DB_PER_DAY: Final = -1.0
"""Rain goes and comes back within days; over up to 14 days so steep a fall is something else."""
DRIFTED: Final = 0.5


@dataclass
class HealthTrend:
    """What is known of one circuit. Times are seconds of a clock that does not step."""

    level_db: float | None = None
    evm_db: float | None = None
    tap_drift: float | None = None
    driest_db: float | None = None
    """Highest hourly mean of the clear circuit's level."""
    telegrams: int = 0
    crc_failures: int = 0
    _recent: deque[bool] = field(default_factory=lambda: deque(maxlen=RECENT))
    _hours: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=KEPT_HOURS))
    _hour: int | None = None
    _sum_db: float = 0.0
    _count: int = 0

    def clear_level(self, level_db: float, evm_db: float | None, t_s: float) -> None:
        """A level of the clear circuit; levels under trains say nothing of its condition."""
        self.level_db = _mean(self.level_db, level_db)
        self.evm_db = self.evm_db if evm_db is None else _mean(self.evm_db, evm_db)
        hour = int(t_s // HOUR_S)
        if self._hour is not None and hour != self._hour and self._count:
            mean_db = self._sum_db / self._count
            self._hours.append(((self._hour + 0.5) * HOUR_S, mean_db))
            self.driest_db = mean_db if self.driest_db is None else max(self.driest_db, mean_db)
            self._sum_db, self._count = 0.0, 0
        self._hour = hour
        self._sum_db += level_db
        self._count += 1

    def telegram(self, *, crc_ok: bool) -> None:
        """A telegram, or a failed check."""
        self.telegrams += crc_ok
        self.crc_failures += not crc_ok
        self._recent.append(crc_ok)

    def drifted(self, drift: float | None) -> None:
        """Distance of the taps from the stored ones."""
        if drift is not None:
            self.tap_drift = _mean(self.tap_drift, drift)

    def trend_db_per_day(self) -> float | None:
        """Slope of the hourly levels; None before half a day of them."""
        if len(self._hours) < FEWEST_HOURS:
            return None
        t_s, level_db = np.array(self._hours).T
        days = (t_s - t_s.mean()) / DAY_S
        return float(days @ (level_db - level_db.mean()) / (days @ days))

    def complaints(self) -> dict[str, str]:
        """What people should look at, by kind; empty when all is well."""
        found = {}
        trend = self.trend_db_per_day()
        if trend is not None and trend < SINKING_DB_PER_DAY:
            found["level"] = f"the clear circuit's level falls by {-trend:.1f} dB per day"
        if self.tap_drift is not None and self.tap_drift > DRIFTED:
            found["taps"] = f"the response is {100.0 * self.tap_drift:.0f} % off the stored one"
        failed = len(self._recent) - sum(self._recent)
        if len(self._recent) == RECENT and failed > FAILING_SHARE * RECENT:
            found["checks"] = f"{failed} of the last {RECENT} telegrams failed their check"
        return found


def _mean(before: float | None, new: float) -> float:
    return new if before is None else before + SMOOTHING * (new - before)
