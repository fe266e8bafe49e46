"""A cumulative pulse count made of a counter that wraps, starts anew, and may count backwards."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

_SLACK_PULSES: Final = 2
"""A sample may fall just before or after a pulse, at both of its ends."""


@dataclass(slots=True)
class PulseCounter:
    """Unwraps one axle's counter.

    `modulus` 0: the counter never wraps. `largest_hz`: pulses per second that the fastest train can
    give; a change beyond it is the counter's, not the train's.
    """

    modulus: int
    largest_hz: float
    pulses: int = 0
    """Cumulative, from 0 at the first reading."""
    resets: int = 0
    _raw: int | None = None
    _time_s: float = -math.inf

    def read(self, raw: int, time_s: float) -> int:
        """Cumulative pulses after a reading. A counter that began anew adds what it has counted since.

        So does one that may have wrapped unseen, by the shortest way; both count as resets.

        >>> counter = PulseCounter(modulus=256, largest_hz=1000.0)
        >>> [counter.read(raw, 0.1 * k) for k, raw in enumerate((250, 4, 3))]
        [0, 10, 9]
        """
        if self._raw is None:
            self._raw, self._time_s = raw, time_s
            return self.pulses
        most = self.largest_hz * max(time_s - self._time_s, 0.0) + _SLACK_PULSES
        step = raw - self._raw
        if self.modulus:
            step = (step + self.modulus // 2) % self.modulus - self.modulus // 2
        if self.modulus and most > self.modulus // 2:
            # Nothing came for so long that the counter may have gone round: the way since is not known.
            self.resets += 1
            self.pulses += step
        elif abs(step) <= most:
            self.pulses += step
        else:
            self.resets += 1
            if 0 <= raw <= most:
                self.pulses += raw
        self._raw, self._time_s = raw, time_s
        return self.pulses
