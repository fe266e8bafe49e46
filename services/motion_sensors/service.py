"""Motion sensors on the bus: an inertial sensor, one or more pulse counters, or a motion log played."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import assert_never

from schemas.motion import ImuBlock, MotionWarning, TachoBlock, WarningKind
from schemas.topics import IMU, MOTION_WARNING, TACHO
from services.byte_source.rate_watch import RateWatch
from services.motion_sensors.adis_frames import AdisFrames
from services.motion_sensors.axle_watch import AxlePair, Recently, StuckWatch
from services.motion_sensors.can_signals import CanImuSamples
from services.motion_sensors.imu_blocks import ImuBlocks
from services.motion_sensors.imu_sample import ImuFrames, ImuSample
from services.motion_sensors.log_playback import blocks_of
from services.motion_sensors.number_rows import ImuRows, NumberRows
from services.motion_sensors.sample_rhythm import MOST_OFF
from services.motion_sensors.sensor_stream import Chunk, Line, chunks, line_of
from services.motion_sensors.settings import AxleInput, Config, ImuInput
from services.motion_sensors.tacho_blocks import TachoBlocks
from services.motion_sensors.vectornav_sentences import VectornavSentences
from services.motion_sensors.xsens_frames import XsensFrames
from services.odometry_fusion.motion_log_file import read_motion_log
from services.runtime.node import Node, Service

NS = 10**9


async def run(node: Node, config: Config) -> None:
    """Publish until stopped, or until a log has ended; a log that cannot be read raises MotionLogError or OSError."""
    if config.log:
        await _play(node, config)
        return
    sensors = MotionSensors(node, config)
    node.ready()
    async with asyncio.TaskGroup() as group:
        if config.imu is not None:
            group.create_task(sensors.follow_imu(config.imu, line_of(config.imu)))
        for axle in config.axles:
            group.create_task(sensors.follow_axle(axle, line_of(axle)))


class MotionSensors:
    """All sensors of one vehicle, and what they say about each other."""

    def __init__(self, node: Node, config: Config) -> None:
        """Begin with nothing heard."""
        self._node = node
        self._config = config
        self._imu: ImuBlocks | None = None
        self._axles: dict[str, TachoBlocks] = {}
        self._active: dict[tuple[str, WarningKind], str] = {}

    async def follow_imu(self, config: ImuInput, line: Line) -> None:
        """Read the inertial sensor until the service is to stop."""
        decoder = _decoder(config)
        blocks = self._imu = ImuBlocks(config, self._config.block_s, decoder.counter_modulus)
        rate, anew = _rate_watch(self._node, config), Recently()
        async for chunk in chunks(self._node, config.device, line, self._config.silence_s):
            arrived_s = self._node.clock.now_ns() / NS
            samples = _imu_samples(decoder, chunk)
            now_s = self._node.clock.monotonic_s()
            for k, sample in enumerate(samples):
                rate.heard(now_s)
                # Samples of one chunk came one after the other; the last one came now.
                before_s = (len(samples) - 1 - k) / config.rate_hz
                block = blocks.take(sample, arrived_s - before_s)
                if block is not None:
                    await self._node.publish(IMU, block, device=config.device)
                    blocks.compare(self._speed_mps())
            restarts = blocks.times.restarts
            counted = f"the sensor began anew {restarts} times" if anew.grown(restarts, now_s) else ""
            faults = {**blocks.warnings, "restart": counted, "rate": rate.fault(now_s)}
            await self._tell(config.device, faults, block_kinds=IMU_KINDS)
            self._count(config.device, {**decoder.counts, "lost_samples": blocks.times.lost})

    async def follow_axle(self, config: AxleInput, line: Line) -> None:
        """Read a pulse counter until the service is to stop."""
        blocks = self._axles[config.device] = TachoBlocks(config, self._config.block_s, self._config.largest_speed_mps)
        stuck, pair, rate, anew = StuckWatch(), AxlePair(), _rate_watch(self._node, config), Recently()
        rows = NumberRows(config.columns, [name for name in ("t_s", "pulses") if name in config.columns])
        first = self._config.axles[0].device
        async for chunk in chunks(self._node, config.device, line, self._config.silence_s):
            arrived_s = self._node.clock.now_ns() / NS
            readings = _readings(config, rows, chunk)
            now_s = self._node.clock.monotonic_s()
            for k, (raw, device_s) in enumerate(readings):
                rate.heard(now_s)
                before_s = (len(readings) - 1 - k) / config.rate_hz
                block = blocks.take(raw, arrived_s - before_s, device_s)
                if block is not None:
                    await self._node.publish(TACHO, block, device=config.device)
            shake = self._imu.shake_mps2() if self._imu else None
            resets = blocks.counter.resets
            faults = {
                "stuck": stuck.fault(blocks.counter.pulses, shake, arrived_s),
                "reset": f"the counter began anew {resets} times" if anew.grown(resets, now_s) else "",
                "rate": rate.fault(now_s),
                "scale": pair.fault(self._axles[first].distance_m, blocks.distance_m)
                if config.device != first and first in self._axles
                else "",
            }
            await self._tell(config.device, faults, block_kinds=AXLE_KINDS)
            self._count(config.device, rows.counts)

    def _speed_mps(self) -> float | None:
        """Speed by the first axle that knows it."""
        return next((axle.speed_mps for axle in self._axles.values() if axle.speed_mps is not None), None)

    async def _tell(self, device: str, faults: dict[str, str], block_kinds: tuple[WarningKind, ...]) -> None:
        """Publish what has become wrong, or right again."""
        for kind in block_kinds:
            reason = faults.get(kind, "")
            known = self._active.get((device, kind), "")
            if bool(reason) == bool(known):
                continue
            self._active[device, kind] = reason
            if reason:
                self._node.health.set(f"{device}_{kind}", f"{device}: {reason}")
            else:
                self._node.health.clear(f"{device}_{kind}")
            warning = MotionWarning(
                t_ns=self._node.clock.now_ns(), device=device, kind=kind, active=bool(reason), reason=reason or "over"
            )
            await self._node.publish(MOTION_WARNING, warning, device=device)

    def _count(self, device: str, counts: dict[str, int]) -> None:
        self._node.health.counts.update({f"{device}_{name}": amount for name, amount in counts.items()})


IMU_KINDS: tuple[WarningKind, ...] = ("saturated", "frozen", "gap", "late", "noise", "axes", "restart", "rate")
AXLE_KINDS: tuple[WarningKind, ...] = ("stuck", "reset", "scale", "rate")


def _rate_watch(node: Node, config: ImuInput | AxleInput) -> RateWatch:
    """Counts samples; beyond this tolerance their stamps would not follow the sensor any more."""
    return RateWatch(config.rate_hz, node.clock.monotonic_s(), what="samples", tolerance=MOST_OFF)


def _decoder(config: ImuInput) -> ImuFrames | CanImuSamples:
    if config.can_layout is not None:
        return CanImuSamples(config.can_layout)
    match config.protocol:
        case "adis":
            return AdisFrames(config.gyro_dps_per_count, config.accelerometer_mg_per_count)
        case "vectornav":
            return VectornavSentences()
        case "xsens":
            return XsensFrames()
        case "rows":
            return ImuRows(config.columns)
        case _:
            assert_never(config.protocol)


def _imu_samples(decoder: ImuFrames | CanImuSamples, chunk: Chunk) -> list[ImuSample]:
    if isinstance(decoder, CanImuSamples):
        frames = chunk if isinstance(chunk, list) else []
        return [sample for frame in frames if (sample := decoder.feed(*frame)) is not None]
    return decoder.feed(chunk) if isinstance(chunk, bytes) else []


def _readings(config: AxleInput, rows: NumberRows, chunk: Chunk) -> list[tuple[int, float | None]]:
    """Counter readings and the sensor's own times."""
    if isinstance(chunk, bytes):
        return [(round(row[-1]), row[0] if len(row) > 1 else None) for row in rows.feed(chunk)]
    signal = config.can_signal
    if signal is None:
        return []
    raws = [signal.raw(content) for frame_id, content in chunk if frame_id == signal.frame_id]
    return [(raw, None) for raw in raws if raw is not None]


async def _play(node: Node, config: Config) -> None:
    """Play a motion log at its own pace, its times moved to now."""
    read = await node.in_thread(lambda: read_motion_log(Path(config.log)))
    node.health.count("issues", len(read.issues))
    if read.issues:
        node.health.set("issues", f"{len(read.issues)} things in the log were left out, the first: {read.issues[0]}")
    node.ready()
    going_on = True
    while going_on and not node.stopping:
        start_ns, start_s = node.clock.now_ns(), node.clock.monotonic_s()
        for block in blocks_of(read.log, config.block_s, start_ns):
            due_s = start_s + (block.t_ns - start_ns) / NS / config.speed
            if not await node.sleep(max(due_s - node.clock.monotonic_s(), 0.0)):
                return
            match block:
                case ImuBlock():
                    await node.publish(IMU, block, device=config.log_device)
                case TachoBlock():
                    await node.publish(TACHO, block, device=config.log_axle)
                case _:
                    assert_never(block)
        going_on = config.repeat


SERVICE = Service(
    "motion_sensors",
    Config,
    reads=(),
    writes=(IMU, TACHO, MOTION_WARNING),
    run=run,
    about="an inertial sensor and pulse counters, live or from a motion log: samples, and what is wrong with them",
)
