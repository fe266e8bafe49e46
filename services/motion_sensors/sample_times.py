"""When a sample was taken: the sensor's own count or clock, tied to the host's by what arrives soonest.

Bytes are delayed by buffers and by the operating system, never hastened. The host's time minus the
sensor's is therefore smallest for whatever was delayed least; that lower envelope, allowed to rise
slowly for the drift between the clocks, is the offset (Moon, Skelly, Towsley 1999, in its simplest form).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

DRIFT: Final = 2e-4
"""Largest difference in rate between two quartz clocks, with room [s/s]."""
JUMP_S: Final = 1.0
"""A sensor's clock that is off by more than this has begun anew."""


@dataclass(slots=True)
class SampleTimes:
    """Stamps samples in host time [s].

    `interval_s` is the nominal time between samples, `latency_s` the time from measurement to the
    soonest arrival (filters of the sensor, transmission).
    """

    interval_s: float
    latency_s: float
    counter_modulus: int = 0
    restarts: int = 0
    lost: int = 0
    """Samples that the sensor's counter says are missing."""
    samples: int = 0
    """Number of the next sample, missing ones counted."""
    _offset_s: float = math.inf
    _sensor_s: float = 0.0
    _host_s: float = -math.inf
    _counter: int | None = field(default=None)
    _last_s: float = -math.inf

    def stamp(self, arrived_s: float, counter: int | None, device_s: float | None) -> float:
        """Time of a sample that arrived at a host time; never before the one before."""
        steps = self._steps(counter)
        sensor_s = device_s if device_s is not None else self._sensor_s + steps * self.interval_s
        passed_s = arrived_s - self._host_s
        if math.isfinite(self._offset_s):
            fresh_s = arrived_s - sensor_s
            known_s = self._offset_s + DRIFT * max(passed_s, 0.0)
            backwards = device_s is not None and device_s < self._sensor_s - self.interval_s
            if backwards or abs(fresh_s - known_s) > JUMP_S:
                self.restarts += 1
                self._offset_s = fresh_s
            else:
                self._offset_s = min(fresh_s, known_s)
        else:
            self._offset_s = arrived_s - sensor_s
        self._sensor_s, self._host_s = sensor_s, arrived_s
        self.samples += steps
        self._last_s = max(sensor_s + self._offset_s - self.latency_s, self._last_s + 1e-6)
        return self._last_s

    def _steps(self, counter: int | None) -> int:
        """By how many samples this one is after the one before; more than one where some were lost."""
        steps = 1
        if counter is not None and self._counter is not None and self.counter_modulus:
            ahead = (counter - self._counter) % self.counter_modulus
            # Half a turn ahead is as good as behind: the sensor started again.
            if 1 <= ahead <= self.counter_modulus // 2:
                steps = ahead
        self._counter = counter
        self.lost += steps - 1
        return steps
