"""The analyzer's service: acknowledged after the commit, said again, asked, and begun again after a crash."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import msgspec
import pytest

from schemas.bridge import StoreQuestion
from schemas.topic import Place
from schemas.topics import INGEST, RADIO_MEASUREMENT, SERVICE_EVENT, STORE
from services.cloud_analyzer.duckdb_store import DuckDbStore
from services.cloud_analyzer.ingest import Ingest
from services.cloud_analyzer.service import SERVICE, Config
from services.runtime.clock import ManualClock
from services.runtime.manual_loop import run_manual
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Node, Service
from services.runtime.question import RefusedError
from tests.unit.cloud_analyzer.batches import DAY_NS, NOW_NS, batch, measurement, service_event

CLOUD = Place("demo", "cloud", "C1")


class NoConfig(msgspec.Struct, frozen=True):
    """Nothing to set."""


async def _idle(node: Node, config: NoConfig) -> None:
    del node, config


ASKER = Service(
    "asker", NoConfig, (RADIO_MEASUREMENT, SERVICE_EVENT), (), _idle, "asks and listens", asks=(INGEST, STORE)
)


def with_analyzer(folder: Path, test: Callable[[MemoryNode, MemoryNode], Awaitable[None]], **config: object) -> None:
    """Run `test` with an asker beside an analyzer that is ready."""

    async def main() -> None:
        clock = ManualClock(asyncio.get_running_loop(), NOW_NS + DAY_NS)
        bus = MemoryBus()
        node, asker = MemoryNode(bus, SERVICE, CLOUD, clock), MemoryNode(bus, ASKER, CLOUD, clock)
        settings = msgspec.convert({"folder": str(folder), **config}, Config)
        running = asyncio.create_task(node.run(settings))
        await node.is_ready.wait()
        await test(node, asker)
        node.stop()
        await running
        asker.stop()

    run_manual(main())


def test_batches_are_kept_said_again_and_can_be_asked_for(tmp_path: Path) -> None:
    async def test(node: MemoryNode, asker: MemoryNode) -> None:
        heard = asker.arrivals(RADIO_MEASUREMENT, SERVICE_EVENT, mirrored=True)
        records = [*(measurement(n) for n in range(30)), *(service_event(n) for n in range(5))]
        reply = await asker.ask(INGEST, CLOUD, batch(records), timeout_s=5.0, shard="all")
        assert (reply.through, reply.repeated, reply.refused) == (34, 0, 0)
        assert (await asker.ask(INGEST, CLOUD, batch(records), timeout_s=5.0, shard="all")).repeated == 35
        again = [await anext(heard) for _ in range(35)]
        assert [one.sequence for one in again] == [*range(30), *range(5)]
        assert {str(one.place) for one in again} == {"demo/train/T1"}
        answer = await asker.ask(
            STORE, CLOUD, StoreQuestion(t_ns=0, about="radio", limit=20), timeout_s=5.0, shard="all"
        )
        assert (len(answer.rows), answer.t_ns) == (20, node.clock.now_ns())
        rest = StoreQuestion(t_ns=0, about="radio", limit=20, page=answer.next_page)
        assert len((await asker.ask(STORE, CLOUD, rest, timeout_s=5.0, shard="all")).rows) == 10
        assert node.health.counts["rows"] == 35

    with_analyzer(tmp_path, test)


def test_what_cannot_be_is_refused_in_words_and_counted(tmp_path: Path) -> None:
    async def test(node: MemoryNode, asker: MemoryNode) -> None:
        foreign = batch([measurement(0)], bridge="east/train/T1/lte_bridge")
        broken = msgspec.structs.replace(batch([measurement(0)]), compressed=b"no zstd")
        for one, words in ((foreign, "no bridge of line demo"), (broken, "zstd")):
            with pytest.raises(RefusedError, match=words):
                await asker.ask(INGEST, CLOUD, one, timeout_s=5.0, shard="all")
        bad_page = StoreQuestion(t_ns=0, about="radio", page="x")
        with pytest.raises(RefusedError, match="no page"):
            await asker.ask(STORE, CLOUD, bad_page, timeout_s=5.0, shard="all")
        newer = msgspec.structs.replace(measurement(0), key="kirotei/v1/demo/train/T1/news/of/tomorrow")
        reply = await asker.ask(INGEST, CLOUD, batch([newer, measurement(1)]), timeout_s=5.0, shard="all")
        assert (reply.through, reply.refused) == (1, 1)
        assert node.health.refused == 2
        assert node.health.counts["undecoded"] == 1

    with_analyzer(tmp_path, test)


def test_what_was_committed_before_a_crash_is_said_again_after_it(tmp_path: Path) -> None:
    store = DuckDbStore(tmp_path)
    taken = Ingest("demo", store.had()).take(batch([measurement(n) for n in range(4)]), NOW_NS)
    store.commit(taken.commit)
    store.close()

    async def test(node: MemoryNode, asker: MemoryNode) -> None:
        heard = asker.arrivals(RADIO_MEASUREMENT, mirrored=True)
        assert [(await anext(heard)).sequence for _ in range(4)] == [0, 1, 2, 3]
        reply = await asker.ask(INGEST, CLOUD, batch([measurement(n) for n in range(4)]), timeout_s=5.0, shard="all")
        assert reply.repeated == 4
        assert node.health.published == 4

    with_analyzer(tmp_path, test)
