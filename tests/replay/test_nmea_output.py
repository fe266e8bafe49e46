"""The NMEA output service: fixes from a bus in memory, read over the loopback."""

from __future__ import annotations

import asyncio
import socket

from msgspec.structs import replace

from schemas.topic import Place
from schemas.topics import GNSS_FIX
from services.nmea_output.sentences import sentences
from services.nmea_output.service import SERVICE, Config
from services.runtime.clock import ManualClock
from services.runtime.guest import guest
from services.runtime.manual_loop import run_manual
from services.runtime.memory_node import MemoryBus, MemoryNode
from tests.unit.nmea_output.test_sentences import FIX

TRAIN = Place("demo", "train", "T1")
LIMIT_S = 5.0
"""Longest wait for anything; reached only when a test fails."""
WRITER = guest("writer", "speaks", writes=(GNSS_FIX,))


def read(client: socket.socket, count: int) -> bytes:
    received = b""
    while len(received) < count:
        part = client.recv(count - len(received))
        assert part
        received += part
    return received


def test_fixes_of_one_device_are_served_to_every_client() -> None:
    async def main() -> None:
        clock = ManualClock(asyncio.get_running_loop(), FIX.t_ns)
        bus = MemoryBus()
        writer, node = MemoryNode(bus, WRITER, TRAIN, clock), MemoryNode(bus, SERVICE, TRAIN, clock)
        running = asyncio.ensure_future(node.run(Config(device="rear", port=0, geoid_m=10.5)))
        await node.is_ready.wait()
        port = node.health.counts["port"]
        clients = [socket.create_connection(("127.0.0.1", port), LIMIT_S) for _ in range(2)]
        lost = replace(FIX, status="none")
        for device, fix in (("front", FIX), ("rear", FIX), ("rear", lost)):
            await writer.publish(GNSS_FIX, fix, device=device)
        await asyncio.sleep(1.0)
        wanted = sentences(FIX, 10.5) + sentences(lost, 10.5)
        for client in clients:
            assert read(client, len(wanted)) == wanted
        assert node.health.counts["sent"] == 2
        assert node.health.counts["clients"] == 2
        node.stop()
        await running
        for client in clients:
            assert client.recv(100) == b""
            client.close()

    run_manual(main())
