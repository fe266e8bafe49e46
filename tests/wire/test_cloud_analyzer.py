"""The analyzer as a process: killed in mid-ingest, started again, asked from the command line."""

from __future__ import annotations

import asyncio
import os
import signal
from pathlib import Path

import duckdb
import msgspec

from schemas.queries import INGEST
from schemas.topic import Place
from schemas.topics import RADIO_MEASUREMENT
from services.radio_anomaly.radio_model_file import read_model
from services.runtime.clock import LiveClock
from services.runtime.guest import guest
from services.runtime.host_config import BusConfig
from services.runtime.node import Node
from services.runtime.question import NoAnswerError, RefusedError
from services.runtime.zenoh_node import ZenohNode
from tests.unit.cloud_analyzer.batches import STEP_NS, batch, measurement
from tests.wire.ports import free_port
from tests.wire.processes import running

CLI = ("-m", "services.cli")
CLOUD = Place("demo", "cloud", "C1")
LIMIT_S = 60.0
"""For anything to happen on a busy machine."""
EACH, BATCHES = 40, 12
BRIDGE = guest("bridge", "a test's bridge", reads=(RADIO_MEASUREMENT,), asks=(INGEST,))


async def bring(node: Node, number: int, begin_ns: int) -> int:
    """Acknowledged number of a batch, asked again and again as a bridge does."""
    first = number * EACH
    records = [
        msgspec.structs.replace(measurement(n, t_ns=begin_ns + n * STEP_NS), heard_ns=begin_ns + n * STEP_NS)
        for n in range(first, first + EACH)
    ]
    async with asyncio.timeout(LIMIT_S):
        while True:
            try:
                brought = batch(records, first, sent_ns=LiveClock().now_ns())
                reply = await node.ask(INGEST, CLOUD, brought, timeout_s=2.0, shard="all")
            except (NoAnswerError, RefusedError):
                await asyncio.sleep(0.1)
                continue
            return reply.through


async def test_what_was_acknowledged_is_there_after_kills_and_can_be_asked_for(tmp_path: Path) -> None:
    port = free_port()
    profile = tmp_path / "cloud.toml"
    profile.write_text(
        f'services = ["cloud_analyzer"]\nstate_dir = "{tmp_path}/state"\n'
        '[place]\nline = "demo"\nkind = "cloud"\nname = "C1"\n'
        f'[bus]\nconnect = ["tcp/127.0.0.1:{port}"]\n'
        f'[router]\nlisten = ["tcp/127.0.0.1:{port}"]\n'
        '[log]\nformat = "json"\n',
        "utf-8",
    )
    with running(*CLI, "up", "--profile", str(profile)) as up:
        pid = up.event("started", child="cloud_analyzer")["pid"]
        await asyncio.to_thread(up.event, "all_ready", patience_s=120.0)
        bus = BusConfig(connect=(f"tcp/127.0.0.1:{port}",))
        node = await ZenohNode.open(BRIDGE, Place("demo", "train", "T1"), "bridge", LiveClock(), bus, announced=False)
        begin_ns = LiveClock().now_ns() - 3600 * 10**9
        try:
            heard = node.arrivals(RADIO_MEASUREMENT, mirrored=True)
            for number in range(BATCHES):
                if number in (4, 8):
                    os.kill(pid, signal.SIGKILL)
                    pid = (await asyncio.to_thread(up.event, "started", child="cloud_analyzer", patience_s=LIMIT_S))[
                        "pid"
                    ]
                assert await bring(node, number, begin_ns) == (number + 1) * EACH - 1
            async with asyncio.timeout(LIMIT_S):
                mirrored = [(await anext(heard)).sequence for _ in range(BATCHES * EACH)]
            assert mirrored == list(range(BATCHES * EACH))
        finally:
            await node.close()
        rows = tmp_path / "rows.parquet"
        asked = ("cloud", "history", "radio", "--most", "10000", "--out", str(rows))
        with running(*CLI, *asked, "--connect", f"tcp/127.0.0.1:{port}") as history:
            assert await asyncio.to_thread(history.ended) == 0, history.errors
        with duckdb.connect() as connection:
            found = connection.execute("SELECT count(*), count(DISTINCT sequence) FROM read_parquet(?)", [str(rows)])
            assert found.fetchone() == (BATCHES * EACH, BATCHES * EACH)
        for words in (
            ("learn",),
            ("history", "models", "--out", f"{tmp_path}/models.csv"),
            ("model", "--out", f"{tmp_path}/m.json", "--send-as", "line"),
        ):
            with running(*CLI, "cloud", *words, "--connect", f"tcp/127.0.0.1:{port}") as command:
                assert await asyncio.to_thread(command.ended) == 0, command.errors
        learned = read_model(tmp_path / "m.json")
        # One pass, and every one of its measurements once.
        assert (learned.origin.passes, learned.origin.readings) == (1, BATCHES * EACH)
        assert (tmp_path / "models.csv").read_text("utf-8").count("\n") == 2
        up.send(signal.SIGINT)
        assert up.ended(6.0) == 0
