"""When a sample was taken: the sensor's own count or clock, tied to the host's by what arrives soonest.

Bytes are delayed by buffers and by the operating system, never hastened. The host's time minus the
sensor's is therefore smallest for whatever was delayed least; that lower envelope, allowed to rise
slowly for the drift between the clocks, is the offset (Moon, Skelly, Towsley 1999, in its simplest form).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from services.motion_sensors.sample_rhythm import SampleRhythm

DRIFT: Final = 2e-4
"""Largest difference in rate between two quartz clocks, with room [s/s]."""
JUMP_S: Final = 1.0
"""A sensor's clock that is off by more than this has begun anew …"""
LATEST_S: Final = 10.0
"""… unless its clock or count goes on without a break: then its samples waited somewhere, up to so long."""
LARGEST_CLOCK_S: Final = 1e11
"""Times beyond this (3,000 years) are no clock's, and too coarse to tell samples apart."""


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
    rhythm: SampleRhythm = field(init=False)
    _offset_s: float = math.inf
    _sensor_s: float = 0.0
    _host_s: float = -math.inf
    _counter: int | None = field(default=None)
    _last_s: float = -math.inf

    def __post_init__(self) -> None:
        """Believe the nominal rate until another one shows."""
        self.rhythm = SampleRhythm(self.interval_s)

    def stamp(self, arrived_s: float, counter: int | None, device_s: float | None) -> float:
        """Time of a sample that arrived at a host time; never before the one before."""
        if device_s is not None and not abs(device_s) <= LARGEST_CLOCK_S:
            device_s = None
        steps, counted_on = self._steps(counter)
        sensor_s = device_s if device_s is not None else self._sensor_s + steps * self.rhythm.interval_s
        backwards = device_s is not None and device_s < self._sensor_s - self.interval_s
        goes_on = not backwards and (device_s is not None or counted_on)
        self._tie(arrived_s, sensor_s, anew=backwards, latest_s=LATEST_S if goes_on else JUMP_S)
        if device_s is None:
            soonest_s = self.rhythm.heard(arrived_s, steps)
            if soonest_s is not None:
                self._offset_s = soonest_s - sensor_s
        self._sensor_s, self._host_s = sensor_s, arrived_s
        self.samples += steps
        self._last_s = max(sensor_s + self._offset_s - self.latency_s, self._last_s + 1e-6)
        return self._last_s

    def _tie(self, arrived_s: float, sensor_s: float, *, anew: bool, latest_s: float) -> None:
        """Follow the lower envelope of host time minus sensor time, or begin it anew."""
        fresh_s = arrived_s - sensor_s
        if not math.isfinite(self._offset_s):
            self._offset_s = fresh_s
            return
        known_s = self._offset_s + DRIFT * max(arrived_s - self._host_s, 0.0)
        if anew or not -JUMP_S <= fresh_s - known_s <= latest_s:
            self.restarts += 1
            self._offset_s = fresh_s
            self.rhythm.forget()
        else:
            self._offset_s = min(fresh_s, known_s)

    def _steps(self, counter: int | None) -> tuple[int, bool]:
        """By how many samples this one is after the one before, and whether the sensor's count says so.

        More than one where some were lost.
        """
        steps, counted_on = 1, False
        if counter is not None and self._counter is not None and self.counter_modulus:
            ahead = (counter - self._counter) % self.counter_modulus
            # Half a turn ahead is as good as behind: the sensor started again.
            if 1 <= ahead <= self.counter_modulus // 2:
                steps, counted_on = ahead, True
        self._counter = counter
        self.lost += steps - 1
        return steps, counted_on
