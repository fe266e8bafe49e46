"""Messages of what a simulated train's sensors send."""

from __future__ import annotations

import numpy as np

from schemas.motion import ImuBlock, TachoBlock
from services.motion_sensors.pulse_counter import PulseCounter
from services.simulator.motion_settings import MotionSettings
from services.simulator.motion_state import STEP_S
from services.simulator.train_sensors import SensorBlock

NS = 1_000_000_000
FASTEST_MPS = 60.0
"""Rim of a spinning wheel; a counter that runs faster began anew."""


class TrainMessages:
    """Turns blocks into messages as a reader of real sensors would."""

    def __init__(self, settings: MotionSettings) -> None:
        """Begin with counters at 0."""
        vehicle, bits = settings.vehicle, settings.tacho.counter_bits
        self._vehicle = vehicle
        self._period_s = 1.0 / settings.tacho.rate_hz
        pulse_m = np.pi * vehicle.wheel_diameter_m / vehicle.teeth
        self._counter = PulseCounter(modulus=1 << bits if bits else 0, largest_hz=FASTEST_MPS / float(pulse_m))
        self._tacho_rows = 0

    def imu(self, block: SensorBlock, t_ns: int) -> ImuBlock | None:
        """Samples that came within the tick that ends at `t_ns` (UTC); None without any."""
        count = len(block.imu)
        if not count:
            return None
        columns = np.ascontiguousarray(block.imu.T)
        return ImuBlock(
            t_ns=t_ns,
            first_sample=block.imu_first,
            offset_ns=np.arange(1 - count, 1, dtype=np.int64) * round(STEP_S * NS),
            ax_mps2=columns[0],
            ay_mps2=columns[1],
            az_mps2=columns[2],
            gx_radps=columns[3],
            gy_radps=columns[4],
            gz_radps=columns[5],
            fault=block.imu_fault,
        )

    def tacho(self, block: SensorBlock, t_ns: int) -> TachoBlock | None:
        """Counts that came within the tick that ends at `t_ns`; None without any."""
        count, first = len(block.counts), self._tacho_rows
        self._tacho_rows += max(round(0.1 / self._period_s), 1)
        if not count:
            return None
        pulses = [
            self._counter.read(int(raw), float(at)) for raw, at in zip(block.counts, block.tacho_t_s, strict=True)
        ]
        return TachoBlock(
            t_ns=t_ns,
            first_sample=first,
            offset_ns=np.arange(1 - count, 1, dtype=np.int64) * round(self._period_s * NS),
            pulses=np.array(pulses, dtype=np.int64),
            resets=self._counter.resets,
            pulses_per_revolution=float(self._vehicle.teeth),
            wheel_diameter_m=self._vehicle.wheel_diameter_m,
        )
