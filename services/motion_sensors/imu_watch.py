"""What is wrong with an inertial sensor's samples: saturated, frozen, missing, late, far too noisy."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from services.motion_sensors.imu_sample import STANDARD_GRAVITY_MPS2, ImuSample

NAMES: Final = ("ax", "ay", "az", "gx", "gy", "gz")
_NEAR_RANGE: Final = 0.995
FROZEN_S: Final = 0.5
"""An axis that gives the same number this long is frozen: the noise of every sensor in use is above its resolution
over half a second, unless the resolution is very coarse (see `frozen_axes`)."""
_HARDEST_MPS2: Final = 8.0 * STANDARD_GRAVITY_MPS2
"""Mean over a block: no vehicle that still runs accelerates so."""


@dataclass(slots=True)
class ImuWatch:
    """Follows samples one after the other. Ranges: what the sensor can measure at most."""

    accelerometer_range_mps2: float
    gyro_range_radps: float
    interval_s: float
    late_after_s: float = 1.0
    _same_since_s: list[float] = field(default_factory=lambda: [math.inf] * 6)
    _before: ImuSample | None = None
    _time_s: float = -math.inf

    def faults(self, sample: ImuSample, time_s: float, now_s: float) -> dict[str, str]:
        """Faults of a sample, each in words; empty when all is well."""
        found: dict[str, str] = {}
        saturated = self._saturated(sample)
        if saturated:
            found["saturated"] = f"{', '.join(saturated)} at the end of the sensor's range"
        frozen = self._frozen(sample, time_s)
        if frozen:
            found["frozen"] = f"{', '.join(frozen)} the same for more than {FROZEN_S:g} s"
        if (hardest := max(map(abs, sample.values[:3]))) > _HARDEST_MPS2:
            found["noise"] = f"acceleration of {hardest:.0f} m/s²: is the scale right?"
        gap_s = time_s - self._time_s - self.interval_s
        if self._before is not None and gap_s > 3.0 * self.interval_s:
            found["gap"] = f"nothing for {gap_s:.2f} s"
        if now_s - time_s > self.late_after_s:
            found["late"] = f"samples come {now_s - time_s:.1f} s late"
        self._before, self._time_s = sample, time_s
        return found

    def _saturated(self, sample: ImuSample) -> list[str]:
        ranges = (self.accelerometer_range_mps2,) * 3 + (self.gyro_range_radps,) * 3
        return [
            name
            for name, value, most in zip(NAMES, sample.values, ranges, strict=True)
            if most > 0.0 and abs(value) >= _NEAR_RANGE * most
        ]

    def _frozen(self, sample: ImuSample, time_s: float) -> list[str]:
        if self._before is None or time_s - self._time_s > FROZEN_S:
            # Two samples alike on both sides of a gap say nothing.
            self._same_since_s = [time_s] * 6
            return []
        for axis in range(6):
            if sample.values[axis] != self._before.values[axis]:
                self._same_since_s[axis] = time_s
        return [name for name, since_s in zip(NAMES, self._same_since_s, strict=True) if time_s - since_s > FROZEN_S]
