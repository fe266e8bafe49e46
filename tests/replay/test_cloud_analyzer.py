"""The analyzer's service: acknowledged after the commit, said again, asked, and begun again after a crash."""

from __future__ import annotations

import asyncio
import resource
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

import msgspec
import pytest

from schemas.bridge import BridgeBatch, BridgedRecord, HistoryTask, StoreAnswer, StoreQuestion
from schemas.codec import MAX_MESSAGE_BYTES, encode
from schemas.queries import HISTORY_TASK, INGEST, STORE
from schemas.topic import Place
from schemas.topics import RADIO_MEASUREMENT, SERVICE_EVENT
from services.cloud_analyzer.duckdb_store import DuckDbStore
from services.cloud_analyzer.ingest import Ingest
from services.cloud_analyzer.service import SERVICE, Config
from services.runtime.clock import ManualClock
from services.runtime.guest import guest
from services.runtime.manual_loop import run_manual
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.question import NoAnswerError, RefusedError
from tests.unit.cloud_analyzer.batches import BRIDGE, DAY_NS, NOW_NS, STEP_NS, batch, measurement, service_event
from tests.unit.cloud_analyzer.radio_days import END_NS, FAULT_NS, bring

CLOUD = Place("demo", "cloud", "C1")
HOUR_NS = 3_600_000_000_000


def sent(records: Sequence[BridgedRecord], first: int = 0, bridge: str = BRIDGE) -> BridgeBatch:
    """A batch from a bridge whose clock is ours."""
    return batch(records, first, bridge, sent_ns=NOW_NS + DAY_NS)


ASKER = guest("asker", "asks and listens", reads=(RADIO_MEASUREMENT, SERVICE_EVENT), asks=(INGEST, STORE, HISTORY_TASK))


def with_analyzer(
    folder: Path,
    test: Callable[[MemoryNode, MemoryNode], Awaitable[None]],
    now_ns: int = NOW_NS + DAY_NS,
    **config: object,
) -> None:
    """Run `test` with an asker beside an analyzer that is ready."""

    async def main() -> None:
        clock = ManualClock(asyncio.get_running_loop(), now_ns)
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
        reply = await asker.ask(INGEST, CLOUD, sent(records), timeout_s=5.0, shard="all")
        assert (reply.through, reply.repeated, reply.refused) == (34, 0, 0)
        assert (await asker.ask(INGEST, CLOUD, sent(records), timeout_s=5.0, shard="all")).repeated == 35
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
        foreign = sent([measurement(0)], bridge="east/train/T1/lte_bridge")
        broken = msgspec.structs.replace(sent([measurement(0)]), compressed=b"no zstd")
        for one, words in ((foreign, "no bridge of line demo"), (broken, "zstd")):
            with pytest.raises(RefusedError, match=words):
                await asker.ask(INGEST, CLOUD, one, timeout_s=5.0, shard="all")
        bad_page = StoreQuestion(t_ns=0, about="radio", page="x")
        with pytest.raises(RefusedError, match="no page"):
            await asker.ask(STORE, CLOUD, bad_page, timeout_s=5.0, shard="all")
        newer = msgspec.structs.replace(measurement(0), key="kirotei/v1/demo/train/T1/news/of/tomorrow")
        reply = await asker.ask(INGEST, CLOUD, sent([newer, measurement(1)]), timeout_s=5.0, shard="all")
        assert (reply.through, reply.refused) == (1, 1)
        assert node.health.refused == 2
        assert node.health.counts["undecoded"] == 1

    with_analyzer(tmp_path, test)


@contextmanager
def no_more_room(folder: Path) -> Iterator[None]:
    """No file of this process may grow: as on a disk that is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    largest = max(path.stat().st_size for path in folder.iterdir() if path.is_file())
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_store_that_refuses_acknowledges_nothing_and_takes_the_batch_when_it_can(tmp_path: Path) -> None:
    async def test(node: MemoryNode, asker: MemoryNode) -> None:
        first, second = (sent([measurement(n) for n in range(at, at + 200)], at) for at in (0, 200))
        await asker.ask(INGEST, CLOUD, first, timeout_s=5.0, shard="all")
        with no_more_room(tmp_path):
            for _ in range(2):
                with pytest.raises(RefusedError, match=r"not taken: the store in .* took nothing"):
                    await asker.ask(INGEST, CLOUD, second, timeout_s=5.0, shard="all")
            # What it has it still tells.
            assert len(await asked(asker, "radio")) == 200
        assert node.health.counts["commits_failed"] == 2
        reply = await asker.ask(INGEST, CLOUD, second, timeout_s=5.0, shard="all")
        assert (reply.through, reply.repeated) == (399, 0)
        assert [row["sequence"] for row in await asked(asker, "radio")] == list(range(400))

    with_analyzer(tmp_path, test, learn_daily=False)


def test_what_a_newer_train_says_is_kept_aside_and_what_it_adds_is_no_fault(tmp_path: Path) -> None:
    """A word that this version does not know, a field more, a topic more: one is refused with its bytes, none stops."""

    async def test(node: MemoryNode, asker: MemoryNode) -> None:
        plain = measurement(0)
        fields = msgspec.msgpack.decode(plain.payload)
        wider = msgspec.structs.replace(measurement(1), payload=msgspec.msgpack.encode(fields | {"polarisation": "v"}))
        strange = msgspec.structs.replace(
            measurement(2), payload=msgspec.msgpack.encode(fields | {"side": "satellite"})
        )
        unknown = msgspec.structs.replace(measurement(3), key="kirotei/v1/demo/train/T1/news/of/tomorrow")
        brought = sent([plain, wider, strange, unknown, measurement(4)])
        reply = await asker.ask(INGEST, CLOUD, brought, timeout_s=5.0, shard="all")
        assert (reply.through, reply.refused) == (4, 2)
        assert [row["sequence"] for row in await asked(asker, "radio")] == [0, 1, 4]
        assert node.health.counts["undecoded"] == 2

    with_analyzer(tmp_path, test)
    with closing(DuckDbStore(tmp_path)) as store:
        kept = store._connection.execute("SELECT key, reason, payload_hex FROM refused ORDER BY key").fetchall()
    assert [key for key, _, _ in kept] == ["kirotei/v1/demo/train/T1/news/of/tomorrow", measurement(2).key]
    assert "satellite" in kept[1][1]
    assert bytes.fromhex(kept[0][2]) == measurement(3).payload


def test_what_was_committed_before_a_crash_is_said_again_after_it(tmp_path: Path) -> None:
    store = DuckDbStore(tmp_path)
    taken = Ingest("demo", store.had()).take(batch([measurement(n) for n in range(4)]), NOW_NS)
    store.commit(taken.commit)
    store.close()

    async def test(node: MemoryNode, asker: MemoryNode) -> None:
        heard = asker.arrivals(RADIO_MEASUREMENT, mirrored=True)
        assert [(await anext(heard)).sequence for _ in range(4)] == [0, 1, 2, 3]
        reply = await asker.ask(INGEST, CLOUD, sent([measurement(n) for n in range(4)]), timeout_s=5.0, shard="all")
        assert reply.repeated == 4
        assert node.health.published == 4

    with_analyzer(tmp_path, test)


async def asked(asker: MemoryNode, about: str, **fields: object) -> list[dict[str, object]]:
    """All rows of an answer, page by page."""
    rows: list[dict[str, object]] = []
    page = ""
    while True:
        question = msgspec.convert({"t_ns": 0, "about": about, "page": page, **fields}, StoreQuestion)
        answer: StoreAnswer = await asker.ask(STORE, CLOUD, question, timeout_s=5.0, shard="all")
        assert len(encode(answer)) <= MAX_MESSAGE_BYTES
        rows += [dict(zip(answer.columns, row, strict=True)) for row in answer.rows]
        if not answer.next_page:
            return rows
        page = answer.next_page


def test_pages_are_cut_to_what_a_message_carries(tmp_path: Path) -> None:
    """Asked for more rows at once than fit, a page gives as many as do and goes on behind them."""

    async def test(_: MemoryNode, asker: MemoryNode) -> None:
        records = [service_event(n, "x" * 900) for n in range(3000)]
        await asker.ask(INGEST, CLOUD, sent(records), timeout_s=5.0, shard="all")
        assert len(encode(sent(records))) < MAX_MESSAGE_BYTES < 3000 * 900
        rows = await asked(asker, "events", limit=50_000)
        assert [row["sequence"] for row in rows] == list(range(3000))
        huge = [service_event(3000, "y" * MAX_MESSAGE_BYTES)]
        await asker.ask(INGEST, CLOUD, sent(huge, 3000), timeout_s=5.0, shard="all")
        with pytest.raises(RefusedError, match="larger than a message"):
            await asked(asker, "events", from_ns=NOW_NS + 3000 * STEP_NS)

    with_analyzer(tmp_path, test)


def test_the_history_is_learned_and_analysed_when_asked(tmp_path: Path) -> None:
    store = DuckDbStore(tmp_path)
    bring(store)
    store.close()

    async def test(node: MemoryNode, asker: MemoryNode) -> None:
        async def done(**task: object) -> tuple[str, int]:
            request = msgspec.convert({"t_ns": 0, **task}, HistoryTask)
            answer = await asker.ask(HISTORY_TASK, CLOUD, request, timeout_s=5.0, shard="all")
            return answer.model, answer.events

        with pytest.raises(RefusedError, match="learn one first"):
            await done(task="analyse")
        version, _ = await done(task="learn", until_ns=FAULT_NS)
        assert [row["version"] for row in await asked(asker, "models")] == [version]
        again, events = await done(task="analyse", from_ns=FAULT_NS)
        assert again == version
        found = await asked(asker, "reanalysed", model=version)
        assert len(found) == events > 0
        assert {row["model"] for row in found} == {version}
        with pytest.raises(RefusedError, match="no model nonsense"):
            await done(task="analyse", model="nonsense")
        assert node.health.counts["tasks_refused"] == 2

    with_analyzer(tmp_path, test, END_NS + DAY_NS, learn_daily=False)


def test_whole_days_are_learned_at_their_hour_and_after_a_start_that_comes_later(tmp_path: Path) -> None:
    store = DuckDbStore(tmp_path)
    bring(store)
    store.close()
    half_an_hour_before_midnight_ns = FAULT_NS + DAY_NS - HOUR_NS // 2

    async def test(node: MemoryNode, asker: MemoryNode) -> None:
        async def known() -> list[tuple[object, object]]:
            return [(row["through_ns"], row["passes"]) for row in await asked(asker, "models")]

        # Its hour went by before it was started: it learns at once.
        assert await known() == [(FAULT_NS, 12)]
        await asyncio.sleep(2.4 * 3600.0)
        assert len(await known()) == 1
        await asyncio.sleep(0.2 * 3600.0)
        assert await known() == [(FAULT_NS, 12), (FAULT_NS + DAY_NS, 14)]
        found = await asked(asker, "reanalysed")
        assert {row["kind"] for row in found if row["confirmed"]} == {"below"}
        assert {row["model"] for row in found} == {(await asked(asker, "models"))[0]["version"]}
        assert node.health.counts["models"] == 2

    with_analyzer(tmp_path, test, half_an_hour_before_midnight_ns, learn_at_hour_utc=2, learn_after_days=0)


def test_lines_have_one_analyzer_each_and_what_nobody_takes_stays_with_its_bridge(tmp_path: Path) -> None:
    """Two lines beside each other: no row in both, none in neither; a line without an analyzer is not answered."""
    lines = ("east", "west", "south")
    clouds = {line: Place(line, "cloud", "C1") for line in lines}

    async def main() -> None:
        clock, bus = ManualClock(asyncio.get_running_loop(), NOW_NS + DAY_NS), MemoryBus()
        asker = MemoryNode(bus, ASKER, CLOUD, clock)
        nodes = {line: MemoryNode(bus, SERVICE, clouds[line], clock) for line in lines[:2]}
        running = [
            asyncio.create_task(node.run(msgspec.convert({"folder": str(tmp_path / line)}, Config)))
            for line, node in nodes.items()
        ]
        for node in nodes.values():
            await node.is_ready.wait()
        unanswered = []
        for number, line in enumerate(lines * 4):
            records = [measurement(number, place=Place(line, "train", "T1"))]
            brought = sent(records, number, bridge=f"{line}/train/T1/lte_bridge")
            try:
                await asker.ask(INGEST, clouds[line], brought, timeout_s=5.0, shard="all")
            except NoAnswerError:
                unanswered.append(number)
            for other in nodes.keys() - {line}:
                with pytest.raises(RefusedError, match=f"no bridge of line {other}"):
                    await asker.ask(INGEST, clouds[other], brought, timeout_s=5.0, shard="all")
        kept = {}
        for line in nodes:
            question = StoreQuestion(t_ns=0, about="radio")
            answer = await asker.ask(STORE, clouds[line], question, timeout_s=5.0, shard="all")
            assert {row[answer.columns.index("line")] for row in answer.rows} == {line}
            kept[line] = [row[answer.columns.index("sequence")] for row in answer.rows]
        for node in nodes.values():
            node.stop()
        await asyncio.gather(*running)
        asker.stop()
        assert kept == {"east": [0, 3, 6, 9], "west": [1, 4, 7, 10]}
        assert unanswered == [2, 5, 8, 11]

    run_manual(main())
