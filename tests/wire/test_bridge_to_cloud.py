"""A bridge and a store as processes: the cloud dies twice in mid-stream, nothing is lost or doubled."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from schemas.bridge import StoreQuestion
from schemas.codec import decode
from schemas.queries import STORE
from schemas.radio import RadioMeasurement
from schemas.runs import RunRecord
from schemas.topic import Place
from schemas.topics import RADIO_MEASUREMENT, RUN_RECORD, SERVICE_EVENT
from services.runtime.clock import LiveClock
from services.runtime.guest import guest
from services.runtime.host_config import BusConfig
from services.runtime.question import NoAnswerError, RefusedError
from services.runtime.zenoh_node import ZenohNode
from tests.unit.cloud_analyzer.batches import measurement
from tests.wire.ports import free_port
from tests.wire.processes import Running, running, write_profile
from tests.wire.stage import event

CLI = ("-m", "services.cli")
CLOUD, TRAIN = Place("demo", "cloud", "C1"), Place("demo", "train", "T1")
RUN = RunRecord(t_ns=0, run_id="", from_station="juso", to_station="toyonaka", running_time_s=421.5, energy_kwh=58.25)
COUNT = 1500
"""Measurements; there is an event with every tenth."""
LIMIT_S = 90.0
"""For everything to arrive on a busy machine."""
WRITER = guest("writer", "a test's sensor", writes=(RADIO_MEASUREMENT, SERVICE_EVENT, RUN_RECORD))
ASKER = guest("asker", "asks and listens", reads=(RADIO_MEASUREMENT, SERVICE_EVENT), asks=(STORE,))


@contextmanager
def cloud_at(folder: Path, port: int) -> Iterator[Running]:
    profile = folder / "cloud.toml"
    endpoint = f'["tcp/127.0.0.1:{port}"]'
    profile.write_text(
        f'services = ["cloud_analyzer"]\nstate_dir = "{folder}/state"\n'
        '[place]\nline = "demo"\nkind = "cloud"\nname = "C1"\n'
        f"[bus]\nconnect = {endpoint}\n[router]\nlisten = {endpoint}\n"
        '[log]\nformat = "json"\n',
        "utf-8",
    )
    with running(*CLI, "up", "--profile", str(profile)) as up:
        yield up


async def stored(asker: ZenohNode, about: str) -> list[int]:
    """Sequence numbers in the store, in its order."""
    found: list[int] = []
    page = ""
    while True:
        question = StoreQuestion(t_ns=0, about=about, limit=1000, page=page)  # type: ignore[arg-type]  # one of them
        answer = await asker.ask(STORE, CLOUD, question, timeout_s=5.0, shard="all")
        at, key = answer.columns.index("sequence"), answer.columns.index("key")
        found += [int(row[at] or 0) for row in answer.rows if "/writer" in str(row[key]) or about == "radio"]
        if not answer.next_page:
            return found
        page = answer.next_page


async def runs_stored(asker: ZenohNode) -> list[RunRecord]:
    """Run records in the store, a page for each, as whoever asks can rebuild them."""
    found: list[RunRecord] = []
    page = ""
    while True:
        question = StoreQuestion(t_ns=0, about="runs", train="T1", limit=1, page=page)
        answer = await asker.ask(STORE, CLOUD, question, timeout_s=5.0, shard="all")
        names = [field.name for field in msgspec.structs.fields(RunRecord)]
        at = [answer.columns.index(name) for name in names]
        found += [
            msgspec.convert(dict(zip(names, (row[index] for index in at), strict=True)), RunRecord)
            for row in answer.rows
        ]
        if not answer.next_page:
            return found
        page = answer.next_page


async def until_stored(asker: ZenohNode, about: str, count: int) -> list[int]:
    found: list[int] = []
    async with asyncio.timeout(LIMIT_S):
        while len(found) < count:
            try:
                found = await stored(asker, about)
            except (NoAnswerError, RefusedError):
                found = []
            await asyncio.sleep(0.3)
    return found


async def test_what_a_train_says_reaches_the_store_once_though_the_cloud_dies(tmp_path: Path) -> None:
    train_port, cloud_port = free_port(), free_port()
    more = (
        '[lte_bridge]\nfar = { kind = "cloud", name = "C1" }\nretry_most_s = 0.5\nanswer_timeout_s = 1.0\n'
        f'uplink = {{ connect = ["tcp/127.0.0.1:{cloud_port}"] }}\n'
    )
    profile = write_profile(tmp_path, train_port, services=("lte_bridge",), more=more)
    (tmp_path / "cloud").mkdir()
    with running(*CLI, "up", "--profile", str(profile)) as up:
        await asyncio.to_thread(up.event, "all_ready", patience_s=LIMIT_S)
        bus = BusConfig(connect=(f"tcp/127.0.0.1:{train_port}",))
        runs: list[RunRecord] = []
        writer = await ZenohNode.open(WRITER, TRAIN, "writer", LiveClock(), bus, announced=False)
        try:
            for part in range(3):
                with cloud_at(tmp_path / "cloud", cloud_port) as cloud:
                    await asyncio.to_thread(cloud.event, "all_ready", patience_s=LIMIT_S)
                    for number in range(part * COUNT // 3, (part + 1) * COUNT // 3):
                        message = decode(RadioMeasurement, measurement(number, t_ns=LiveClock().now_ns()).payload)
                        await writer.publish(RADIO_MEASUREMENT, message, device="r1")
                        if number % 10 == 0:
                            await writer.publish(SERVICE_EVENT, event(number), service="writer")
                        if number % 250 == 0:
                            now_ns = LiveClock().now_ns()
                            runs.append(
                                msgspec.structs.replace(RUN, t_ns=now_ns, arrival_ns=now_ns, run_id=str(number))
                            )
                            await writer.publish(RUN_RECORD, runs[-1])
                    if part < 2:
                        await asyncio.sleep(0.2 + 0.4 * part)
                        cloud.send(signal.SIGKILL)
                        cloud.ended()
                        continue
                    asker_bus = BusConfig(connect=(f"tcp/127.0.0.1:{cloud_port}",))
                    asker = await ZenohNode.open(ASKER, CLOUD, "asker", LiveClock(), asker_bus, announced=False)
                    try:
                        radio = await until_stored(asker, "radio", COUNT)
                        # Events overtake bulk, and run records are events: by now they are there.
                        events = await until_stored(asker, "events", COUNT // 10)
                        runs_there = await runs_stored(asker)
                    finally:
                        await asker.close()
                    cloud.send(signal.SIGINT)
                    assert cloud.ended(6.0) == 0
        finally:
            await writer.close()
        up.send(signal.SIGINT)
        assert up.ended(6.0) == 0
    assert sorted(radio) == list(range(COUNT))
    assert sorted(events) == list(range(COUNT // 10))
    assert runs_there == runs
    assert len(runs) == COUNT // 250
