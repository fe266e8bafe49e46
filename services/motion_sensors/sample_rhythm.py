"""How long a sample of a sensor without a clock lasts: its quartz, or worse, is not what its data sheet says.

Inertial sensors sample within 3 % of their nominal rate (ADIS16470 data sheet). The soonest arrivals of
successive windows lie on a line over the number of the sample; its slope is the time of one sample.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

WINDOW_S: Final = 4.0
_WINDOWS: Final = 16
"""A minute: warming sensors change their rate slowly."""
WAITED_S: Final = 0.1
"""A window whose soonest sample is this late says nothing of the rate: its samples waited somewhere."""
MOST_OFF: Final = 0.1
"""Share of the nominal time by which a sample may last longer or shorter; beyond, the configured rate is wrong."""


@dataclass(slots=True)
class SampleRhythm:
    """Time of one sample, estimated from arrivals [s]. `nominal_s`: what it is believed to be until that is known."""

    nominal_s: float
    interval_s: float = field(init=False)
    _number: int = 0
    _began_s: float = math.inf
    _least: tuple[int, float] = (0, math.inf)
    """Number and lateness against the nominal rhythm of the soonest sample of this window."""
    _soonest: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=_WINDOWS))

    def __post_init__(self) -> None:
        """Believe the nominal rate."""
        self.interval_s = self.nominal_s

    def heard(self, arrived_s: float, steps: int) -> float | None:
        """Take a sample `steps` after the one before.

        Gives when it would have arrived soonest, whenever that is known anew.
        """
        self._number += steps
        late_s = arrived_s - self._number * self.nominal_s
        if late_s < self._least[1]:
            self._least = self._number, late_s
        self._began_s = min(self._began_s, arrived_s)
        if arrived_s - self._began_s < WINDOW_S:
            return None
        number, least_s = self._least
        self._began_s, self._least = arrived_s, (0, math.inf)
        if len(self._soonest) > 1:
            last, last_s = self._soonest[-1]
            if least_s - last_s - (number - last) * (self.interval_s - self.nominal_s) > WAITED_S:
                return None
        self._soonest.append((number, least_s))
        (first, first_s), (last, last_s) = self._soonest[0], self._soonest[-1]
        if last == first:
            return None
        most_s = MOST_OFF * self.nominal_s
        longer_s = min(max((last_s - first_s) / (last - first), -most_s), most_s)
        self.interval_s = self.nominal_s + longer_s
        return last_s + self._number * self.nominal_s + (self._number - last) * longer_s

    def forget(self) -> None:
        """Keep the rate, but none of the arrivals: the sensor began anew."""
        self._soonest.clear()
        self._began_s, self._least = math.inf, (0, math.inf)
