"""What a train's inertial sensor and pulse counter send, block by block, faults included."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.position import FaultKind
from services.simulator.motion_settings import MotionSettings
from services.simulator.motion_simulator import MotionSamples
from services.simulator.motion_state import STEP_S
from services.simulator.tachometer import Tachometer

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

BLOCK: Final = 10
"""Samples of the inertial sensor per block: 0.1 s."""
SATURATED_MPS2: Final = 9.80665
SATURATED_RADPS: Final = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class SensorBlock:
    """What came in within one block of 0.1 s; times since the start."""

    imu_t_s: Floats
    """Stamps, late by the sensor's latency; empty when nothing came."""
    imu: Floats
    """Shape (n, 6)."""
    imu_first: int
    """Number of the first sample since the sensor started."""
    imu_fault: str
    """What the sensor itself notices."""
    tacho_t_s: Floats
    counts: Counts
    """As the counter shows them: it wraps and resets."""


class TrainSensors:
    """Both sensors of one train."""

    def __init__(self, settings: MotionSettings, generator: np.random.Generator) -> None:
        """Draw the wheel."""
        self._imu_settings = settings.imu
        self.tacho = Tachometer(settings.tacho, settings.vehicle, generator)
        self._every = 100 // settings.tacho.rate_hz
        self._late = round(settings.imu.latency_s / STEP_S)
        self._imu_waiting = np.zeros((0, 6))
        self._imu_sent = 0
        self._rim_waiting = np.zeros(0)
        self._frozen: Floats | None = None
        self._lost_rim_m = 0.0
        self._last_rim_m = 0.0
        self._was_reset = False

    def block(self, samples: MotionSamples, faults: dict[FaultKind, float]) -> SensorBlock:
        """Take BLOCK samples in and give what the sensors send at their times."""
        imu, first = self._imu_block(samples.imu, faults)
        stamps = samples.t_s[BLOCK - len(imu) :]
        rims = self._tacho_block(samples.wheel_way_m[self._every - 1 :: self._every], faults)
        times = samples.t_s[self._every - 1 :: self._every]
        if "tacho_reset" in faults and not self._was_reset:
            self.tacho.reset()
        self._was_reset = "tacho_reset" in faults
        counts = self.tacho.counts(rims, round(faults.get("tacho_missing_teeth", 0.0)))
        saturated = "saturated" if "imu_saturated" in faults and len(imu) else ""
        return SensorBlock(stamps, imu, first, saturated, times[len(times) - len(rims) :], counts)

    def _imu_block(self, new: Floats, faults: dict[FaultKind, float]) -> tuple[Floats, int]:
        """Samples that come out now: as late as the sensor is, and later while it is late."""
        self._imu_waiting = np.concatenate([self._imu_waiting, new])
        late = self._late + round(faults.get("imu_late", 0.0) / STEP_S)
        surplus = len(self._imu_waiting) - late
        dropped = max(surplus - BLOCK, 0)
        out = self._imu_waiting[dropped : max(surplus, 0)]
        self._imu_waiting = self._imu_waiting[max(surplus, 0) :]
        first = self._imu_sent + dropped
        self._imu_sent = first + len(out)
        if "imu_lost" in faults:
            return out[:0], self._imu_sent
        return self._distorted(out.copy(), faults), first

    def _distorted(self, imu: Floats, faults: dict[FaultKind, float]) -> Floats:
        if "imu_frozen" in faults and len(imu):
            if self._frozen is None:
                self._frozen = imu[0].copy()
            imu[:] = self._frozen
            return imu
        self._frozen = None
        imu[:, 3:] += faults.get("gyro_bias", 0.0)
        imu[:, 0] += faults.get("accelerometer_bias", 0.0)
        if "imu_axes_swapped" in faults:
            # Turned by a quarter about the vertical: x shows what y should, y the opposite of x.
            imu[:, [0, 1]] = np.stack([imu[:, 1], -imu[:, 0]], axis=1)
            imu[:, [3, 4]] = np.stack([imu[:, 4], -imu[:, 3]], axis=1)
        if "imu_saturated" in faults:
            share = faults["imu_saturated"]
            np.clip(imu[:, :3], -share * SATURATED_MPS2, share * SATURATED_MPS2, out=imu[:, :3])
            np.clip(imu[:, 3:], -share * SATURATED_RADPS, share * SATURATED_RADPS, out=imu[:, 3:])
        return imu

    def _tacho_block(self, rims: Floats, faults: dict[FaultKind, float]) -> Floats:
        """Ways of the rim that are counted now; what passes while the sensor is stuck is lost."""
        if "tacho_stuck" in faults:
            self._lost_rim_m += float(rims[-1]) - self._last_rim_m
            shown = np.full(len(rims), rims[-1] - self._lost_rim_m)
        else:
            shown = rims - self._lost_rim_m
        self._last_rim_m = float(rims[-1])
        self._rim_waiting = np.concatenate([self._rim_waiting, shown])
        late = round(faults.get("tacho_late", 0.0) * 100 / self._every)
        surplus = max(len(self._rim_waiting) - late, 0)
        out = self._rim_waiting[max(surplus - len(rims), 0) : surplus]
        self._rim_waiting = self._rim_waiting[surplus:]
        return out[:0] if "tacho_lost" in faults else out
