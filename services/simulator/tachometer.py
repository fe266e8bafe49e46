"""A pulse counter on an axle: from the way of the wheel's rim to counts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.simulator.motion_settings import Tacho, Vehicle

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]


class Tachometer:
    """Counts teeth that pass; the true wheel is not quite as large as the nominal one."""

    def __init__(self, tacho: Tacho, vehicle: Vehicle, generator: np.random.Generator) -> None:
        """Draw wear and where the first tooth stands."""
        drawn = tacho.wheel_scale_sigma * float(generator.standard_normal())
        scale = drawn if tacho.wheel_scale is None else tacho.wheel_scale
        self.diameter_m = vehicle.wheel_diameter_m * (1.0 + scale)
        """True diameter."""
        self._tacho, self._teeth = tacho, vehicle.teeth
        self._phase = float(generator.uniform())
        self._there = max(self._teeth - tacho.missing_teeth, 1)
        self._offset = self._tooth = 0

    def counts(self, rim_way_m: Floats, more_missing: int = 0) -> Counts:
        """Counts since the start at ways of the rim since the start (n,), falling when it turns backwards.

        Of a wheel with teeth missing, side by side, these pass uncounted; `more_missing` adds to them
        from now on. A narrow counter wraps.
        """
        there = max(self._teeth - self._tacho.missing_teeth - more_missing, 1)
        if there != self._there:
            self._offset += self._passed(self._tooth, self._there) - self._passed(self._tooth, there)
            self._there = there
        way_m = rim_way_m if self._tacho.tells_direction else np.abs(rim_way_m)
        teeth = np.floor(way_m / (np.pi * self.diameter_m) * self._teeth + self._phase).astype(np.int64)
        if len(teeth):
            self._tooth = int(teeth[-1])
        counted = teeth // self._teeth * there + np.minimum(teeth % self._teeth, there) + self._offset
        return counted % (1 << self._tacho.counter_bits) if self._tacho.counter_bits else counted

    def reset(self) -> None:
        """Begin anew from 0."""
        self._offset = -self._passed(self._tooth, self._there)

    def _passed(self, tooth: int, there: int) -> int:
        """Teeth counted up to a place on the wheel, `there` of a revolution's being there."""
        return tooth // self._teeth * there + min(tooth % self._teeth, there)
