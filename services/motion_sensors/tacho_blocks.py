"""Readings of a pulse counter gathered into messages, unwrapped."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from schemas.motion import TachoBlock
from services.motion_sensors.pulse_counter import PulseCounter
from services.motion_sensors.sample_times import SampleTimes
from services.motion_sensors.settings import AxleInput

NS: Final = 10**9
_ROOM: Final = 1.3
"""Spinning wheels turn faster than the vehicle runs."""
_WINDOW_S: Final = 1.0


@dataclass(slots=True, eq=False)
class TachoBlocks:
    """One counter's readings on their way into messages."""

    config: AxleInput
    block_s: float
    largest_speed_mps: float
    speed_mps: float | None = None
    """Of the rim, over the last second; None before."""
    times: SampleTimes = field(init=False)
    counter: PulseCounter = field(init=False)
    _held: list[tuple[float, int]] = field(default_factory=list)
    _window: list[tuple[float, int]] = field(default_factory=list)
    _first: int = 0
    _last_s: float = 0.0
    _counted_s: float = 0.0

    def __post_init__(self) -> None:
        """Begin before the first reading."""
        self.times = SampleTimes(1.0 / self.config.rate_hz, self.config.latency_s)
        self.counter = PulseCounter(self.config.modulus, _ROOM * self.largest_speed_mps / self.pulse_m)

    @property
    def pulse_m(self) -> float:
        """Way of the rim per pulse."""
        return math.pi * self.config.diameter_m / self.config.teeth

    @property
    def distance_m(self) -> float:
        """Way of the rim since the first reading."""
        return self.counter.pulses * self.pulse_m

    def take(self, raw: int, arrived_s: float, device_s: float | None = None) -> TachoBlock | None:
        """Message that a reading completes, if it does."""
        time_s = self.times.stamp(arrived_s, None, device_s)
        block = (
            self._block()
            if self._held and time_s - self._held[0][0] >= self.block_s - 0.5 / self.config.rate_hz
            else None
        )
        if not self._held:
            self._first = self.times.samples - 1
        # Readings that came in one burst were still taken a period apart.
        self._counted_s += max(time_s - self._last_s, 1.0 / self.config.rate_hz)
        self._last_s = time_s
        pulses = self.counter.read(-raw if self.config.backwards else raw, self._counted_s)
        self._held.append((time_s, pulses))
        self._window.append((time_s, pulses))
        while time_s - self._window[0][0] > _WINDOW_S:
            self._window.pop(0)
        passed_s = time_s - self._window[0][0]
        if passed_s > 0.0:
            self.speed_mps = (pulses - self._window[0][1]) * self.pulse_m / passed_s
        return block

    def _block(self) -> TachoBlock:
        held, self._held = self._held, []
        last_ns = round(held[-1][0] * NS)
        return TachoBlock(
            t_ns=last_ns,
            first_sample=self._first,
            offset_ns=np.array([round(time_s * NS) - last_ns for time_s, _ in held], np.int64),
            pulses=np.array([pulses for _, pulses in held], np.int64),
            resets=self.counter.resets,
            pulses_per_revolution=self.config.teeth,
            wheel_diameter_m=self.config.diameter_m,
        )
