"""The store on two ClickHouse nodes: the same results as the embedded one, and a dead node that is told."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import msgspec
import pytest

from schemas.bridge import BridgedRecord, HistoryTask, StoreQuestion
from services.cloud_analyzer.clickhouse_socket import Node
from services.cloud_analyzer.clickhouse_store import ClickHouseStore
from services.cloud_analyzer.duckdb_store import DuckDbStore
from services.cloud_analyzer.history import Store, StoreError
from services.cloud_analyzer.history_work import HistoryWork
from services.cloud_analyzer.ingest import Ingest
from tests.unit.cloud_analyzer.batches import DAY_NS, NOW_NS, batch, measurement, service_event
from tests.unit.cloud_analyzer.radio_days import END_NS, FAULT_NS, READINGS, bring
from tests.wire.clickhouse_nodes import SERVER, Server, start_two

pytestmark = pytest.mark.skipif(SERVER is None, reason="no clickhouse-server on this machine")
COUNT = 4000
ALL_RADIO = StoreQuestion(t_ns=0, about="radio", limit=50_000)
QUESTIONS = (
    StoreQuestion(t_ns=0, about="radio", limit=700, from_chainage_m=100.0, until_chainage_m=4000.0),
    StoreQuestion(t_ns=0, about="radio", limit=50_000, radio="R3", train="T1", until_ns=NOW_NS + DAY_NS),
    StoreQuestion(t_ns=0, about="events", limit=7, kind="level"),
)


@pytest.fixture(scope="module")
def servers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Server, Server]]:
    first, second = start_two(tmp_path_factory.mktemp("clickhouse"))
    yield first, second
    for server in (first, second):
        if server.process.poll() is None:
            server.stop()


@contextmanager
def cluster(servers: tuple[Server, Server], folder: Path, line: str = "demo") -> Iterator[ClickHouseStore]:
    nodes = [Node(server.url, timeout_s=10.0) for server in servers]
    with closing(ClickHouseStore(nodes, folder, line=line, database="kirotei", cluster="fleet")) as store:
        yield store


def spread(numbers: range) -> list[BridgedRecord]:
    """Measurements under several keys, so that both shards get some."""
    return [
        msgspec.structs.replace(measurement(n), key=measurement(n).key.replace("/r1/", f"/r{n % 8}/")) for n in numbers
    ]


def fill(store: Store) -> None:
    ingest = Ingest("demo", store.had())
    events = [service_event(n, "it's \\ fine\n") for n in range(20)]
    for first, records in ((0, spread(range(COUNT))), (COUNT, events)):
        taken = ingest.take(batch(records, first, sent_ns=NOW_NS + DAY_NS), NOW_NS + DAY_NS)
        store.published(store.commit(taken.commit))
        ingest.confirm(taken)


def all_rows(store: Store, question: StoreQuestion) -> list[tuple[object, ...]]:
    rows: list[tuple[object, ...]] = []
    while True:
        answer = store.ask(question, 10.0)
        assert answer.partial == ""
        rows += answer.rows
        if not answer.next_page:
            return rows
        question = msgspec.structs.replace(question, page=answer.next_page)


def test_two_nodes_give_what_the_embedded_store_gives(servers: tuple[Server, Server], tmp_path: Path) -> None:
    with cluster(servers, tmp_path / "there") as there, closing(DuckDbStore(tmp_path / "here")) as here:
        fill(there)
        fill(here)
        for question in QUESTIONS:
            expected = all_rows(here, question)
            assert len(expected) > 10
            assert all_rows(there, question) == expected
        learned, expected_sums = there.learn(by_day=True), here.learn(by_day=True)
        assert len(learned.sums) == len(expected_sums.sums) > 100
        for one, other in zip(learned.sums, expected_sums.sums, strict=True):
            assert one[:7] == other[:7]
            # The nodes add in another order.
            assert one.total == pytest.approx(other.total, rel=1e-9)
            assert one.squares == pytest.approx(other.squares, rel=1e-9)
        # A batch that comes again, because a crash lay between its rows and what is remembered of it: no row twice.
        with cluster(servers, tmp_path / "again") as again:
            fill(again)
        assert len(all_rows(there, ALL_RADIO)) == COUNT
        assert "dropped" in there.tend(NOW_NS + 1000 * DAY_NS)
        assert all_rows(there, ALL_RADIO) == []


def worked_on(store: Store, line: str) -> list[list[tuple[object, ...]]]:
    """A model learned from the days before the fault, a daily update through it, and all that they left."""
    bring(store, line=line)
    for task, until_ns in (("learn", FAULT_NS), ("analyse", END_NS), ("update", END_NS)):
        asked = HistoryTask(t_ns=0, task=task, until_ns=until_ns)  # type: ignore[arg-type]  # one of them
        store.keep(HistoryWork(store, line).do(asked, until_ns + DAY_NS)[1])
    return [all_rows(store, StoreQuestion(t_ns=0, about=about)) for about in ("models", "model_parts", "reanalysed")]


def test_models_and_what_they_find_are_those_of_the_embedded_store_and_lines_stay_apart(
    servers: tuple[Server, Server], tmp_path: Path
) -> None:
    with (
        cluster(servers, tmp_path / "there", "east") as there,
        cluster(servers, tmp_path / "other", "west") as other,
        closing(DuckDbStore(tmp_path / "here")) as here,
    ):
        bring(other, READINGS[: len(READINGS) // 2], "west")
        expected = worked_on(here, "east")
        assert all(len(rows) >= 2 for rows in expected)
        assert worked_on(there, "east") == expected
        # The nodes hold both lines; either analyzer answers about its own alone.
        assert len(all_rows(there, ALL_RADIO)) == len(READINGS)
        assert len(all_rows(other, ALL_RADIO)) == len(READINGS) // 2
        assert all_rows(other, StoreQuestion(t_ns=0, about="models")) == []
        assert sum(one.n for one in other.learn().sums) < sum(one.n for one in there.learn().sums)


def test_a_dead_node_gives_a_partial_answer_that_says_so_and_takes_nothing(
    servers: tuple[Server, Server], tmp_path: Path
) -> None:
    with cluster(servers, tmp_path / "there") as store:
        fill(store)
        whole = store.ask(ALL_RADIO, 10.0)
        servers[1].stop()
        part = store.ask(ALL_RADIO, 10.0)
        assert 0 < len(part.rows) < len(whole.rows) == COUNT
        assert "shard of fleet did not answer" in part.partial
        assert "shard of fleet" in store.learn().partial
        later = batch(spread(range(COUNT, COUNT + 100)), COUNT + 20, sent_ns=NOW_NS + DAY_NS)
        more = Ingest("demo", store.had()).take(later, NOW_NS + DAY_NS)
        with pytest.raises(StoreError):
            store.commit(more.commit)
        with pytest.raises(StoreError, match="nothing is learned from a part"):
            HistoryWork(store, "demo").do(HistoryTask(t_ns=0, task="learn"), NOW_NS + DAY_NS)
        servers[0].stop()
        with pytest.raises(StoreError, match="does not answer"):
            store.ask(ALL_RADIO, 10.0)
