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

    def counts(self, rim_way_m: Floats) -> Counts:
        """Counts since the start at ways of the rim since the start (n,), falling when it turns backwards.

        Of a wheel with teeth missing, side by side, these pass uncounted. A narrow counter wraps.
        """
        way_m = rim_way_m if self._tacho.tells_direction else np.abs(rim_way_m)
        teeth = np.floor(way_m / (np.pi * self.diameter_m) * self._teeth + self._phase).astype(np.int64)
        there = max(self._teeth - self._tacho.missing_teeth, 1)
        counted = teeth // self._teeth * there + np.minimum(teeth % self._teeth, there)
        return self.wrapped(counted)

    def wrapped(self, counts: Counts) -> Counts:
        """Counts as a counter of the settings' width holds them."""
        return counts % (1 << self._tacho.counter_bits) if self._tacho.counter_bits else counts
