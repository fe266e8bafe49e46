"""A live sensor's line: opened, read, and opened again when it fails, as frames or bytes come."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Protocol, TypeVar

from services.byte_source.serial_stream import SerialLine
from services.byte_source.source import READ_S, RetryPauses, SourceError
from services.byte_source.tcp_socket import TcpConnection
from services.motion_sensors.can_socket import CanConnection
from services.motion_sensors.settings import AxleInput, ImuInput
from services.runtime.node import Node

T_co = TypeVar("T_co", bound=bytes | list[tuple[int, bytes]], covariant=True)
Chunk = bytes | list[tuple[int, bytes]]


class Line(Protocol):
    """A connection that blocks; `read` gives nothing when nothing came within READ_S."""

    @property
    def name(self) -> str:
        """Where it comes from."""

    def open(self) -> None:
        """Connect. Raises SourceError."""

    def read(self) -> Chunk:
        """What has come. Raises SourceError."""

    def close(self) -> None:
        """Disconnect."""


def line_of(sensor: ImuInput | AxleInput) -> Line:
    """Connection that a sensor's settings name."""
    if sensor.serial is not None:
        return SerialLine(sensor.serial.port, sensor.serial.baud)
    if sensor.tcp is not None:
        return TcpConnection(sensor.tcp.host, sensor.tcp.port)
    if sensor.can is None:
        msg = f"{sensor.device} has no source"
        raise ValueError(msg)
    return CanConnection(sensor.can.interface, sensor.can.channel)


async def chunks(node: Node, device: str, line: Line, silence_s: float) -> AsyncIterator[Chunk]:
    """What a line brings, until the service is to stop; health says what is wrong with it under the device's name."""
    pauses = RetryPauses()
    while not node.stopping:
        fault = ""
        try:
            await node.in_thread(line.open)
            node.health.count(f"{device}_connections")
            silent_s = 0.0
            while not fault and await node.sleep(0.0):
                chunk = await node.in_thread(line.read)
                silent_s = 0.0 if chunk else silent_s + READ_S
                if silent_s >= silence_s:
                    fault = f"nothing came for {silent_s:.1f} s"
                if chunk:
                    pauses.reset()
                    node.health.clear(f"{device}_line")
                    yield chunk
        except SourceError as error:
            fault = str(error)
        finally:
            await node.in_thread(line.close)
        if not node.stopping:
            pause_s = pauses.take()
            node.health.set(f"{device}_line", f"{line.name}: {fault}; trying again in {pause_s:.0f} s", "failed")
            await node.sleep(pause_s)
