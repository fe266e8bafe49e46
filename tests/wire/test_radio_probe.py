"""The radio probe as a process: a logger on TCP that goes away and comes back, a train that tells its place."""

from __future__ import annotations

import asyncio
import signal
import socket
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from schemas.position import TrainPosition
from schemas.radio import RadioMeasurement
from schemas.topic import Place
from schemas.topics import RADIO_MEASUREMENT, TRAIN_POSITION
from services.runtime.clock import LiveClock
from services.runtime.guest import guest
from services.runtime.host_config import BusConfig, RouterConfig
from services.runtime.node import Arrival
from services.runtime.router import open_router
from services.runtime.zenoh_node import ZenohNode
from tests.wire.ports import free_port
from tests.wire.processes import PATIENCE_S, running, write_profile

ROWS: Final = 50
TRAIN: Final = Place("demo", "train", "T1")
READER: Final = guest("reader", "listens, and is the train", reads=(RADIO_MEASUREMENT,), writes=(TRAIN_POSITION,))


@contextmanager
def logger() -> Iterator[int]:
    """A device on a port that sends its rows in two connections, the first cut off in the middle of a line."""
    server = socket.create_server(("127.0.0.1", 0))
    server.settimeout(PATIENCE_S)
    header = b"radio,channel,power_dbm\n"

    def serve() -> None:
        for part in range(2):
            connection, _ = server.accept()
            with connection:
                rows = [f"R01,ch1,{-50 - number}\n".encode() for number in range(part * ROWS, (part + 1) * ROWS)]
                connection.sendall(header + b"".join(rows) + (b"R01,ch" if part == 0 else b""))
                if part == 1:
                    # Kept open until the probe is gone: this connection is not lost.
                    connection.settimeout(PATIENCE_S)
                    connection.recv(1)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield server.getsockname()[1]
    finally:
        thread.join(PATIENCE_S)
        server.close()


async def _stand(node: ZenohNode) -> None:
    """Say again and again where the train stands."""
    while True:
        position = TrainPosition(
            t_ns=node.clock.now_ns(), status="valid", reason="", branch="", axis_m=800.0, chainage_m=5000.0,
            direction="up", speed_mps=0.0, bound_ahead_m=2.0, bound_behind_m=3.0, standstill=True,
        )  # fmt: skip
        await node.publish(TRAIN_POSITION, position)
        await asyncio.sleep(0.05)


async def _take(arrivals: AsyncIterator[Arrival[RadioMeasurement]], count: int) -> list[RadioMeasurement]:
    return [(await anext(arrivals)).message for _ in range(count)]


async def test_every_row_arrives_once_though_the_logger_goes_away(tmp_path: Path) -> None:
    port = free_port()
    bus = BusConfig(connect=(f"tcp/127.0.0.1:{port}",))
    with open_router(RouterConfig(listen=(f"tcp/127.0.0.1:{port}",))), logger() as source:
        more = (
            "[radio_probe]\nbus = false\nwait_s = 20.0\nlargest_gap_s = 60.0\n[[radio_probe.inputs]]\n"
            f'device = "logger"\ntcp = {{ host = "127.0.0.1", port = {source} }}\nstamps = "arrival"\n'
        )
        profile = write_profile(tmp_path, port, more=more)
        node = await ZenohNode.open(READER, TRAIN, "reader", LiveClock(), bus, announced=False)
        try:
            arrivals = node.arrivals(RADIO_MEASUREMENT)
            standing = asyncio.ensure_future(_stand(node))
            with running("-m", "services.cli", "run", "radio_probe", "--config", str(profile)) as process:
                got = await asyncio.wait_for(_take(arrivals, 2 * ROWS), 2.0 * PATIENCE_S)
                process.send(signal.SIGTERM)
                assert process.ended() == 0
            standing.cancel()
        finally:
            await node.close()
    assert sorted(one.channel_power_dbm or 0.0 for one in got) == [-50.0 - number for number in range(2 * ROWS)][::-1]
    # The first ones may have come before the train's first word; a second later its words are there.
    later = [one for one in got if (one.channel_power_dbm or 0.0) <= -50.0 - ROWS]
    assert {(one.axis_m, one.chainage_m, one.place_bound_m, one.direction) for one in later} == {
        (800.0, 5000.0, 3.0, "up")
    }
