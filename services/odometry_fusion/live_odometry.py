"""Odometry of live blocks: which samples are used when, and what becomes a message."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import Final

import msgspec
import numpy as np

from schemas.motion import ImuBlock, Odometry, SlipEpisode, TachoBlock, WheelScale
from services.odometry_fusion.axle_choice import AxleChoice
from services.odometry_fusion.first_motion import FirstMotion
from services.odometry_fusion.first_rest import UNVOUCHED, FirstRest, Rest, RestShaking, Shaking, stated_rest
from services.odometry_fusion.fused_odometry import LARGEST_SCALE, FusedOdometry
from services.odometry_fusion.methods import begin
from services.odometry_fusion.motion_log import (
    Counts,
    Floats,
    MotionRows,
    OdometryStep,
    Remembered,
    SixAxes,
    Vehicle,
)
from services.odometry_fusion.row_messages import episode_of, odometry_of
from services.odometry_fusion.sample_buffer import UNUSABLE, SampleBuffer
from services.odometry_fusion.settings import Config

NS: Final = 1e9
MOST_AXLES: Final = 8
START_WAIT_S: Final = 2.0
"""Odometry begins with the axles heard within this time of the first sample, or when all configured ones are."""
LONGEST_STEP_S: Final = 30.0
"""Rows are made up for at most this long a silence at once."""


class _Axle:
    """One counter: its samples, and the odometry made of them."""

    def __init__(self, device: str, counts: Counter[str]) -> None:
        self.buffer = SampleBuffer(device, counts)
        self.vehicle: tuple[float, float] | None = None
        self.step: OdometryStep | None = None
        self.motion: FirstMotion | None = None
        """While it is not vouched for because it turned when all began."""


class LiveOdometry:
    """Takes blocks in, gives messages; begins anew, with another origin, when clocks or wheels change."""

    def __init__(self, config: Config, place: str, run: int, known: Remembered | None) -> None:
        """`run` counts the starts of the service, so that no two origins are named alike."""
        self._config = config
        self._prefix = f"{place}-{run}"
        self._known = known
        self._origins = 0
        self.counts: Counter[str] = Counter()
        self._shaking = RestShaking(_shaking_of(known) or stated_rest(config.imu_rest_mps2, config.imu_rest_radps))
        self._begin()

    def _begin(self) -> None:
        """Forget all samples; the next row is the zero of a new origin."""
        self._origins += 1
        self.origin = f"{self._prefix}.{self._origins}"
        self._imu = SampleBuffer("imu", self.counts)
        self._imu_device = self._config.imu
        self._axles: dict[str, _Axle] = {}
        self._base_ns: int | None = None
        self._first_ns: int | None = None
        self._choice = AxleChoice()
        self._running: list[_Axle] = []
        self._due_ns = 0
        self._rest = FirstRest(self._shaking.level)
        self._unvouched_m = 0.0
        self._stands = False

    def _begin_anew(self) -> None:
        self.counts["begun_anew"] += 1
        self._begin()

    @property
    def devices(self) -> tuple[str | None, str | None]:
        """The inertial sensor in use, and the axle that leads."""
        names = [name for name, axle in self._axles.items() if axle in self._running]
        return self._imu_device, names[self._choice.leader] if names else None

    def remembered(self) -> Remembered | None:
        """What to keep for the next start."""
        found = self._running[self._choice.leader].step if self._running else None
        now = None if found is None else found.remembered()
        level = self._shaking.level
        if now is not None and level is not None:
            now = replace(now, rest_mps2=level.force_mps2, rest_radps=level.rate_radps)
        if now is None or self._known is None or now.wheel_scale is not None:
            return self._known if now is None else now
        # A method without use for the scale keeps it for one that has.
        kept = self._known
        return replace(now, wheel_scale=kept.wheel_scale, wheel_scale_sigma=kept.wheel_scale_sigma)

    def take_scale(self, told: WheelScale) -> None:
        """The leading axle's wheel scale, as references tell it; also for the next start."""
        if abs(told.scale - 1.0) > LARGEST_SCALE or told.sigma >= LARGEST_SCALE:
            self.counts["wheel_scale_refused"] += 1
            return
        known = Remembered() if self._known is None else self._known
        self._known = replace(known, wheel_scale=told.scale, wheel_scale_sigma=told.sigma)
        step = self._running[self._choice.leader].step if self._running else None
        if isinstance(step, FusedOdometry) and step.take_scale(told.scale, told.sigma):
            self.counts["wheel_scale_taken"] += 1

    def take(self, block: ImuBlock | TachoBlock, device: str) -> list[Odometry | SlipEpisode]:
        """Messages that a block makes due."""
        match block:
            case ImuBlock():
                self._imu_device = self._imu_device or device
                if device != self._imu_device:
                    self.counts["imu_unused"] += 1
                    return []
                self._imu.add_imu(block)
                leapt = self._imu.leapt
            case TachoBlock():
                axle = self._axle(device)
                if axle is None:
                    self.counts["tacho_unused"] += 1
                    return []
                wheel = (block.pulses_per_revolution, block.wheel_diameter_m)
                changed = axle.vehicle is not None and axle.vehicle != wheel
                axle.vehicle = wheel
                axle.buffer.add_tacho(block)
                leapt = axle.buffer.leapt or changed
        if leapt:
            self.counts["begun_anew"] += 1
            self._known = self.remembered()
            if isinstance(block, TachoBlock) and changed and self._known is not None:
                self._known = replace(self._known, wheel_scale=None, wheel_scale_sigma=0.0)
            self._begin()
            return self.take(block, device)
        found = self._due() if self._watch_rest(block, device) else []
        if any(axle.motion is not None and axle.motion.over for axle in self._running):
            # What was learned from a wheel that slipped is worth nothing.
            self._begin_anew()
        return found

    def _watch_rest(self, block: ImuBlock | TachoBlock, device: str) -> bool:
        """Whether rows may be given: not yet while a few samples more will tell whether the train stands.

        What was learned from a wheel that was locked is worth nothing: all begins anew then.
        """
        rest = self._rest
        if self._config.method == "wheel":
            return True
        times_ns = block.offset_ns + block.t_ns
        match block:
            case ImuBlock() if not block.fault.startswith(UNUSABLE):
                imu: SixAxes = np.column_stack(_axes_of(block))
                whole = np.isfinite(imu).all(axis=1)
                self._shaking.take_imu(times_ns[whole], imu[whole], stands=self._stands and rest.state is Rest.SURE)
                rest.take_imu(times_ns[whole], imu[whole])
            case TachoBlock():
                metres_per_pulse = math.pi * block.wheel_diameter_m / block.pulses_per_revolution
                rest.take_way(device, times_ns, block.pulses.astype(np.float64) * metres_per_pulse)
            case _:
                pass
        if rest.state is Rest.OVER:
            self._begin_anew()
        return rest.state is not Rest.WAITING

    def _axle(self, device: str) -> _Axle | None:
        """The axle of a device; None for one that is not wanted, or comes when all is running."""
        wanted = self._config.axles
        if device not in self._axles:
            late = self._running or len(self._axles) >= MOST_AXLES
            if late or (wanted and device not in wanted):
                return None
            self._axles[device] = _Axle(device, self.counts)
        return self._axles[device]

    def _due(self) -> list[Odometry | SlipEpisode]:
        """Rows whose samples are there, or have been waited for."""
        lasts = [axle.buffer.last_ns for axle in (self._running or self._axles.values())]
        heard = [one for one in lasts if one is not None]
        if not heard:
            return []
        if self._config.method != "wheel":
            lasts.append(self._imu.last_ns)
            heard += [one for one in (self._imu.last_ns,) if one is not None]
        newest_ns = max(heard)
        if not self._running:
            self._first_ns = min(heard) if self._first_ns is None else self._first_ns
            wanted = self._config.axles
            complete = len(heard) == len(lasts) and bool(wanted) and len(self._axles) == len(wanted)
            if not complete and newest_ns - self._first_ns < START_WAIT_S * NS:
                return []
            self._start()
        waited_ns = newest_ns - round(self._config.longest_wait_s * NS)
        return self._rows(max(min(heard), waited_ns) if len(heard) == len(lasts) else waited_ns)

    def silent(self, silent_s: float) -> list[Odometry | SlipEpisode]:
        """Rows without samples, `silent_s` after the last ones came."""
        lasts = [axle.buffer.last_ns for axle in self._running] + [self._imu.last_ns]
        newest_ns = max((one for one in lasts if one is not None), default=None)
        if (
            newest_ns is None
            or not self._running
            or self._rest.state is Rest.WAITING
            or silent_s < self._config.silence_s
        ):
            return []
        return self._rows(newest_ns + round((min(silent_s, LONGEST_STEP_S) - self._config.longest_wait_s) * NS))

    def _start(self) -> None:
        order = list(self._config.axles) or sorted(self._axles)
        self._axles = {name: self._axles[name] for name in order if name in self._axles}
        for axle in self._axles.values():
            if axle.buffer.last_ns is None or axle.vehicle is None:
                continue
            vehicle = Vehicle(*axle.vehicle, self._config.imu_latency_s, self._config.max_gradient_permille)
            axle.step = begin(vehicle, self._config, self._known_of(axle))
            if self._rest.begun_turning:
                axle.motion = FirstMotion(self._config.imu_latency_s, self._shaking.level)
            self._running.append(axle)

    def _known_of(self, axle: _Axle) -> Remembered | None:
        """What was learned; the wheels' scale is that of the axle that led."""
        if self._known is None or axle is next(iter(self._axles.values())):
            return self._known
        return replace(self._known, wheel_scale=None, wheel_scale_sigma=0.0)

    def _rows(self, until_ns: int) -> list[Odometry | SlipEpisode]:
        imu_ns, imu = self._imu.take()
        values: SixAxes = np.concatenate(imu).astype(np.float64) if imu else np.empty((0, 6))
        counted: list[tuple[Counts, Counts]] = []
        for axle in self._running:
            times_ns, pulses = axle.buffer.take()
            counted.append((times_ns, np.concatenate(pulses).astype(np.int64) if pulses else np.empty(0, np.int64)))
        if self._base_ns is None:
            self._base_ns = max(int(times_ns[0]) for times_ns, _ in counted)
            counted = [_from(self._base_ns, times_ns, pulses) for times_ns, pulses in counted]
        base_ns = self._base_ns
        self._due_ns = max(self._due_ns, until_ns)
        until_s, imu_s = (self._due_ns - base_ns) / NS, _s(imu_ns, base_ns)
        rows: list[MotionRows] = []
        for axle, (times_ns, counts) in zip(self._running, counted, strict=True):
            if axle.step is None or axle.vehicle is None:
                continue
            given = axle.step.advance(until_s, imu_s, values, _s(times_ns, base_ns), counts)
            if axle.motion is not None:
                way_m = counts.astype(np.float64) * (math.pi * axle.vehicle[1] / axle.vehicle[0])
                axle.motion.note(given)
                axle.motion.take(imu_ns, values, times_ns, way_m)
                given = axle.motion.vouched(given, base_ns)
            rows.append(given)
        return self._messages(self._choice.advance(rows), base_ns)

    def _messages(self, rows: MotionRows, base_ns: int) -> list[Odometry | SlipEpisode]:
        method, origin = self._config.method, self.origin
        found: list[Odometry | SlipEpisode] = [episode_of(one, base_ns, origin) for one in rows.episodes]
        found += [self._vouched(odometry_of(rows, at, base_ns, method, origin)) for at in range(len(rows))]
        self._stands = bool(rows.standstill[-1]) if len(rows) else self._stands
        return sorted(found, key=lambda one: one.t_ns)

    def _vouched(self, row: Odometry) -> Odometry:
        """The row with what a wheel that may have been locked from the beginning adds to its error."""
        unsure, since_ns = self._rest.state is Rest.UNSURE, self._rest.unsure_since_ns
        if unsure and since_ns is not None:
            self._unvouched_m = max(self._unvouched_m, self._rest.fastest_mps * (row.t_ns - since_ns) / NS)
        if not self._unvouched_m:
            return row
        wider = msgspec.structs.replace(
            row, excess_m=row.excess_m + self._unvouched_m, bound_m=row.bound_m + self._unvouched_m
        )
        if not unsure:
            return wider
        return msgspec.structs.replace(
            wider,
            speed_bound_mps=self._rest.fastest_mps,
            standstill=False,
            status="lost" if row.status == "lost" else "degraded",
            reason="; ".join(one for one in (UNVOUCHED, row.reason) if one),
            curvature_per_m=None,
            curvature_sigma_per_m=None,
            curvature_distance_m=None,
        )


def _shaking_of(known: Remembered | None) -> Shaking | None:
    """What was kept of the sensor at rest."""
    return None if known is None else stated_rest(known.rest_mps2, known.rest_radps)


def _axes_of(block: ImuBlock) -> tuple[Floats, ...]:
    return (block.ax_mps2, block.ay_mps2, block.az_mps2, block.gx_radps, block.gy_radps, block.gz_radps)


def _s(t_ns: Counts, base_ns: int) -> Floats:
    return (t_ns - base_ns) / NS


def _from(base_ns: int, times_ns: Counts, pulses: Counts) -> tuple[Counts, Counts]:
    """Counts from an instant on, with the count that stood then: all axles begin their rows there."""
    at = int(np.searchsorted(times_ns, base_ns, side="right")) - 1
    begun_ns = np.r_[base_ns, times_ns[at + 1 :]]
    return begun_ns, np.r_[pulses[at], pulses[at + 1 :]]
