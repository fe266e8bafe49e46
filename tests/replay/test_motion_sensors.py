"""The motion sensors on a bus in memory, over scripted lines and over real sockets."""

from __future__ import annotations

import asyncio
import socket
import threading
from pathlib import Path

import can
import numpy as np
import pytest

from schemas.motion import ImuBlock, MotionWarning, TachoBlock
from schemas.topic import Place
from schemas.topics import IMU, MOTION_WARNING, TACHO
from services.byte_source.settings import TcpSource
from services.byte_source.source import SourceError
from services.motion_sensors.can_signals import CanImuLayout, CanSignal
from services.motion_sensors.sensor_stream import Chunk
from services.motion_sensors.service import SERVICE, MotionSensors
from services.motion_sensors.settings import AxleInput, CanSource, Config, ImuInput
from services.runtime.clock import LoopTime, ManualClock
from services.runtime.guest import guest
from services.runtime.manual_loop import run_manual
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Node, Service

TRAIN = Place("demo", "train", "T1")
NOW_NS = 1_800_000_000 * 10**9
Message = ImuBlock | TachoBlock | MotionWarning
TCP = TcpSource(host="127.0.0.1", port=1)
READER = guest("reader", "listens", reads=(IMU, TACHO, MOTION_WARNING))


class ScriptedLine:
    """Brings what it was given, chunk by chunk, then breaks."""

    name = "scripted"

    def __init__(self, *chunks: Chunk) -> None:
        self._chunks = list(chunks)
        self.opened = 0

    def open(self) -> None:
        self.opened += 1
        if self.opened > 1:
            msg = "no more"
            raise SourceError(msg)

    def read(self) -> Chunk:
        if not self._chunks:
            msg = "it broke"
            raise SourceError(msg)
        return self._chunks.pop(0)

    def close(self) -> None: ...


class PacedLine(ScriptedLine):
    """Brings one line after another, each `every_s` after the one before, by its own time."""

    def __init__(self, every_s: float, text: bytes) -> None:
        super().__init__(*text.splitlines(keepends=True))
        self._every_s, self._now_s = every_s, 0.0

    def read(self) -> Chunk:
        self._now_s += self._every_s
        return super().read()

    def time(self) -> float:
        return self._now_s


def play(config: Config, pace: LoopTime | None = None, **lines: ScriptedLine) -> tuple[list[Message], MemoryNode]:
    """What the sensors publish until every line has broken, in the loop's time or at a pace of their own."""

    async def main() -> tuple[list[Message], MemoryNode]:
        clock = ManualClock(pace or asyncio.get_running_loop(), NOW_NS)
        bus = MemoryBus()
        reader = MemoryNode(bus, READER, TRAIN, clock)
        arrivals = reader.arrivals(IMU, TACHO, MOTION_WARNING)

        async def follow(node: Node, config: Config) -> None:
            sensors = MotionSensors(node, config)
            async with asyncio.TaskGroup() as group:
                for axle in config.axles:
                    group.create_task(sensors.follow_axle(axle, lines[axle.device]))
                if config.imu is not None:
                    group.create_task(sensors.follow_imu(config.imu, lines[config.imu.device]))

        scripted = Service("motion_sensors", Config, reads=(), writes=SERVICE.writes, run=follow, about="scripted")
        node = MemoryNode(bus, scripted, TRAIN, clock)
        running = asyncio.ensure_future(node.run(config))
        await asyncio.sleep(5.0)
        node.stop()
        await running
        reader.stop()
        return [one.message async for one in arrivals], node

    return run_manual(main())


def imu_rows(count: int, gz: float | None = None) -> bytes:
    random = np.random.default_rng(3)
    lines = []
    for k in range(count):
        values = random.normal(0.0, 0.01, 6)
        values[2] += 9.8
        if gz is not None:
            values[5] = gz
        lines.append(f"{0.01 * k:.2f}," + ",".join(f"{one:.6f}" for one in values) + "\n")
    return "".join(lines).encode()


def test_both_sensors_are_published_and_a_broken_line_is_said() -> None:
    config = Config(imu=ImuInput(tcp=TCP), axles=(AxleInput(tcp=TCP, vehicle="conventional"),))
    counts = "".join(f"{0.1 * k:.1f} {6 * k}\n" for k in range(20)).encode()
    messages, node = play(config, imu=ScriptedLine(imu_rows(95)), axle1=ScriptedLine(counts))
    blocks = [one for one in messages if isinstance(one, ImuBlock)]
    assert sum(len(one.ax_mps2) for one in blocks) == 90
    tachos = [one for one in messages if isinstance(one, TachoBlock)]
    assert [int(one.pulses[-1]) for one in tachos] == [6 * k for k in range(19)]
    level, reasons = node.health.level(0.0)
    assert level == "failed"
    assert any("scripted: no more" in reason for reason in reasons)


def test_a_frozen_axis_is_told_once_and_marked_in_every_message() -> None:
    config = Config(imu=ImuInput(tcp=TCP))
    messages, node = play(config, imu=ScriptedLine(imu_rows(200, gz=0.01)))
    warnings = [one for one in messages if isinstance(one, MotionWarning)]
    assert [(one.device, one.kind, one.active) for one in warnings] == [("imu", "frozen", True)]
    assert any("gz the same" in one.fault for one in messages if isinstance(one, ImuBlock))
    assert any("gz the same" in reason for reason in node.health.level(0.0)[1])


@pytest.mark.parametrize(("rate_hz", "kinds"), [(100.0, []), (200.0, ["rate"]), (50.0, ["rate"])])
def test_a_sensor_of_another_rate_is_told(rate_hz: float, kinds: list[str]) -> None:
    config = Config(imu=ImuInput(tcp=TCP, rate_hz=rate_hz))
    line = PacedLine(0.01, imu_rows(800))
    messages, node = play(config, line, imu=line)
    warnings = [one for one in messages if isinstance(one, MotionWarning) and one.active]
    assert [one.kind for one in warnings] == kinds
    assert any("100 samples per second instead of" in reason for reason in node.health.level(0.0)[1]) == bool(kinds)


def test_nonsense_on_the_line_publishes_nothing_and_is_counted() -> None:
    config = Config(imu=ImuInput(tcp=TCP, protocol="xsens"))
    messages, node = play(config, imu=ScriptedLine(bytes(range(256)) * 20))
    assert messages == []
    assert node.health.counts["imu_skipped_bytes"] > 4000


def test_lines_come_over_tcp() -> None:
    """A real connection: the service dials, the sensor sends and hangs up."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        connection, _ = server.accept()
        with connection:
            connection.sendall(imu_rows(55))

    sender = threading.Thread(target=serve, daemon=True)
    sender.start()

    async def main() -> list[ImuBlock]:
        clock = ManualClock(asyncio.get_running_loop(), NOW_NS)
        bus = MemoryBus()
        reader, node = MemoryNode(bus, READER, TRAIN, clock), MemoryNode(bus, SERVICE, TRAIN, clock)
        arrivals = reader.arrivals(IMU)
        source = TcpSource(host="127.0.0.1", port=server.getsockname()[1])
        running = asyncio.ensure_future(node.run(Config(imu=ImuInput(tcp=source))))
        await asyncio.sleep(0.5)
        server.close()
        node.stop()
        await running
        reader.stop()
        return [one.message async for one in arrivals]

    blocks = run_manual(main())
    sender.join(5.0)
    assert sum(len(one.ax_mps2) for one in blocks) == 50


def test_frames_come_over_can() -> None:
    def at(frame_id: int, start_bit: int, scale: float) -> CanSignal:
        return CanSignal(frame_id=frame_id, start_bit=start_bit, bits=16, signed=True, scale=scale)

    layout = CanImuLayout(
        ax_mps2=at(1, 0, 0.01),
        ay_mps2=at(1, 16, 0.01),
        az_mps2=at(1, 32, 0.01),
        gx_radps=at(2, 0, 0.001),
        gy_radps=at(2, 16, 0.001),
        gz_radps=at(2, 32, 0.001),
        counter=CanSignal(frame_id=2, start_bit=48, bits=16),
    )
    bus_name = "kirotei-test"
    sender = can.Bus(interface="virtual", channel=bus_name)

    async def main() -> list[ImuBlock | TachoBlock]:
        clock = ManualClock(asyncio.get_running_loop(), NOW_NS)
        bus = MemoryBus()
        reader, node = MemoryNode(bus, READER, TRAIN, clock), MemoryNode(bus, SERVICE, TRAIN, clock)
        arrivals = reader.arrivals(IMU, TACHO)
        source = CanSource(interface="virtual", channel=bus_name)
        signal = CanSignal(frame_id=3, start_bit=0, bits=16)
        axle = AxleInput(can=source, can_signal=signal, vehicle="axle_load_controlled", rate_hz=100.0)
        config = Config(imu=ImuInput(can=source, can_layout=layout), axles=(axle,))
        running = asyncio.ensure_future(node.run(config))
        await asyncio.sleep(0.01)  # both lines are open
        for k in range(60):
            words = [(1, (5 * k, -3, 980)), (2, (1, 2, 3 + k)), (3, (k,))]
            for frame_id, numbers in words:
                content = b"".join(n.to_bytes(2, "little", signed=True) for n in numbers)
                content += k.to_bytes(2, "little") if frame_id == 2 else b""
                sender.send(can.Message(arbitration_id=frame_id, data=content, is_extended_id=False))
        await asyncio.sleep(0.01)  # and have read
        node.stop()
        await running
        reader.stop()
        return [one.message async for one in arrivals]

    try:
        messages = asyncio.run(main())
    finally:
        sender.shutdown()
    ax = np.concatenate([one.ax_mps2 for one in messages if isinstance(one, ImuBlock)])
    assert len(ax) >= 40
    assert ax == pytest.approx(0.05 * np.arange(len(ax)))
    pulses = np.concatenate([one.pulses for one in messages if isinstance(one, TachoBlock)])
    assert pulses.tolist() == list(range(len(pulses)))


def test_a_motion_log_is_played_from_now_on(tmp_path: Path) -> None:
    folder = tmp_path / "log"
    folder.mkdir()
    about = "pulses_per_revolution = 90\nwheel_diameter_m = 0.816\nimu_latency_s = 0.0\nmax_gradient_permille = 35.0\n"
    (folder / "motion.toml").write_text(about)
    header = "t_s,ax_mps2,ay_mps2,az_mps2,gx_radps,gy_radps,gz_radps\n"
    (folder / "imu.csv").write_bytes(header.encode() + imu_rows(300))
    (folder / "tacho.csv").write_text("t_s,pulses\n" + "".join(f"{0.1 * k:.1f},{6 * k}\n" for k in range(30)))

    async def main() -> list[tuple[float, Message]]:
        clock = ManualClock(asyncio.get_running_loop(), NOW_NS)
        bus = MemoryBus()
        reader, node = MemoryNode(bus, READER, TRAIN, clock), MemoryNode(bus, SERVICE, TRAIN, clock)
        arrivals = reader.arrivals(IMU, TACHO)
        await node.run(Config(log=str(folder), speed=2.0))
        reader.stop()
        return [((one.received_ns - NOW_NS) / 1e9, one.message) async for one in arrivals]

    played = run_manual(main())
    assert sum(len(one.ax_mps2) for _, one in played if isinstance(one, ImuBlock)) == 300
    for arrived_s, message in played:
        # Twice as fast as recorded.
        assert arrived_s == pytest.approx((message.t_ns - NOW_NS) / 2e9, abs=1e-6)
