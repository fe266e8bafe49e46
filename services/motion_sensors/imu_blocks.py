"""Samples of an inertial sensor gathered into messages, in vehicle axes, with what is wrong with them."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.motion import ImuBlock
from services.motion_sensors.imu_sample import ImuSample
from services.motion_sensors.imu_watch import ImuWatch
from services.motion_sensors.mounting import angles_rotation, axes_rotation, fault_at_rest, fault_in_curve
from services.motion_sensors.sample_times import SampleTimes
from services.motion_sensors.settings import ImuInput

Warnings = dict[str, str]
"""Kind of warning, and what is wrong in words."""

NS: Final = 10**9
_REST_S: Final = 2.0
"""Samples of this time decide whether the axes are right at rest."""
_CURVE_BLOCKS: Final = 10


@dataclass(slots=True, eq=False)
class ImuBlocks:
    """One sensor's samples on their way into messages. `clock_ns` is the host's time of zero seconds."""

    config: ImuInput
    block_s: float
    counter_modulus: int = 0
    warnings: Warnings = field(default_factory=dict)
    """What is wrong now."""
    times: SampleTimes = field(init=False)
    _watch: ImuWatch = field(init=False)
    _rotation: NDArray[np.float64] = field(init=False)
    _held: list[tuple[float, float, ImuSample]] = field(default_factory=list)
    """Time, arrival, sample."""
    _first: int = 0
    _recent: deque[NDArray[np.float64]] = field(init=False)
    _curve: deque[str] = field(default_factory=lambda: deque(maxlen=_CURVE_BLOCKS))

    def __post_init__(self) -> None:
        """Begin before the first sample."""
        interval_s = 1.0 / self.config.rate_hz
        self.times = SampleTimes(interval_s, self.config.latency_s, self.counter_modulus)
        self._watch = ImuWatch(
            self.config.accelerometer_range_mps2, math.radians(self.config.gyro_range_dps), interval_s
        )
        angles = (math.radians(one) for one in (self.config.roll_deg, self.config.pitch_deg, self.config.yaw_deg))
        self._rotation = angles_rotation(*angles) @ axes_rotation(self.config.axes)
        self._recent = deque(maxlen=max(round(_REST_S / self.block_s), 1))

    def take(self, sample: ImuSample, arrived_s: float) -> ImuBlock | None:
        """Message that a sample completes, if it does. Samples missing by the sensor's count end a message too."""
        before = self.times.samples
        time_s = self.times.stamp(arrived_s, sample.counter, sample.device_s)
        missing = self.times.samples - before > 1
        whole = bool(self._held) and (missing or time_s - self._held[0][0] >= self.block_s - 0.5 / self.config.rate_hz)
        block = self._block() if whole else None
        if not self._held:
            self._first = self.times.samples - 1
        self._held.append((time_s, arrived_s, sample))
        return block

    def compare(self, speed_mps: float | None) -> None:
        """Judge the axes by the last message's mean in a curve, of a speed that another sensor measured."""
        if speed_mps is None or not self._recent:
            return
        mean = self._recent[-1].mean(axis=0)
        found = fault_in_curve(speed_mps, float(mean[1]), float(mean[5]))
        if found is not None:
            self._curve.append(found)
        if len(self._curve) == self._curve.maxlen and all(self._curve):
            self.warnings["axes"] = self._curve[-1]
        elif self._curve and not any(self._curve) and not self._tilted():
            self.warnings.pop("axes", None)

    def shake_mps2(self) -> float | None:
        """Spread of the acceleration along z over the last messages; None before there are enough."""
        if len(self._recent) < (self._recent.maxlen or 1):
            return None
        return float(np.std(np.concatenate(self._recent)[:, 2]))

    def _block(self) -> ImuBlock:
        held, self._held = self._held, []
        last_ns = round(held[-1][0] * NS)
        faults: Warnings = {}
        for time_s, arrived_s, sample in held:
            faults.update(self._watch.faults(sample, time_s, arrived_s))
            if sample.fault:
                faults["noise"] = sample.fault
        values = np.array([sample.values for *_, sample in held])
        turned = np.concatenate([values[:, :3] @ self._rotation.T, values[:, 3:] @ self._rotation.T], axis=1)
        self._recent.append(turned)
        for kind in ("saturated", "frozen", "gap", "late", "noise"):
            if kind in faults:
                self.warnings[kind] = faults[kind]
            else:
                self.warnings.pop(kind, None)
        self._judge_rest()
        columns = np.ascontiguousarray(turned.T)
        return ImuBlock(
            t_ns=last_ns,
            first_sample=self._first,
            offset_ns=np.array([round(time_s * NS) - last_ns for time_s, *_ in held], np.int64),
            ax_mps2=columns[0],
            ay_mps2=columns[1],
            az_mps2=columns[2],
            gx_radps=columns[3],
            gy_radps=columns[4],
            gz_radps=columns[5],
            temperature_c=held[-1][2].temperature_c,
            fault="; ".join(faults[kind] for kind in ("saturated", "frozen", "noise") if kind in faults),
        )

    def _tilted(self) -> str:
        """What the last messages say of the axes at rest; empty when nothing or not at rest."""
        if len(self._recent) < (self._recent.maxlen or 1):
            return ""
        samples = np.concatenate(self._recent)
        return fault_at_rest(samples[:, :3], samples[:, 3:]) or ""

    def _judge_rest(self) -> None:
        if len(self._recent) < (self._recent.maxlen or 1):
            return
        samples = np.concatenate(self._recent)
        found = fault_at_rest(samples[:, :3], samples[:, 3:])
        if found:
            self.warnings["axes"] = found
        elif found == "" and not any(self._curve):
            self.warnings.pop("axes", None)
