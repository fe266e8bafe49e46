"""Takes what bridges bring, keeps it, says it again under mirrored keys, learns from it, answers questions about it."""

from __future__ import annotations

import asyncio
import math
import os
from collections import deque
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import msgspec
from msgspec import Meta

from schemas.bridge import (
    BridgeAcknowledgement,
    BridgeBatch,
    HistoryTask,
    HistoryTaskDone,
    StoreAnswer,
    StoreQuestion,
)
from schemas.queries import HISTORY_TASK, INGEST, STORE
from services.cloud_analyzer import clickhouse_socket
from services.cloud_analyzer.clickhouse_store import ClickHouseStore
from services.cloud_analyzer.duckdb_store import DuckDbStore
from services.cloud_analyzer.history import DAY_NS, Store, StoreError
from services.cloud_analyzer.history_work import HistoryWork
from services.cloud_analyzer.ingest import Ingest
from services.cloud_analyzer.pages import told
from services.cloud_analyzer.tables import LATE_DAYS
from services.lte_bridge.batch import BatchError
from services.radio_anomaly.settings import Settings as RadioSettings
from services.runtime.host_config import Settings
from services.runtime.node import Node, Sample, Service
from services.runtime.question import Question
from services.runtime.state_dir import state_dir

T = TypeVar("T")
TEND_S = 600.0
SETTLE_S = 4.0
LOOK_S = 60.0
"""Between two looks at whether the hour of learning has come."""
HOUR_NS = 3_600_000_000_000


class ClickHouseSettings(Settings, frozen=True, kw_only=True):
    """A fleet's store."""

    urls: Annotated[tuple[str, ...], Meta(min_length=1)] = ("http://127.0.0.1:8123",)
    """HTTP interfaces of all nodes."""
    database: str = "kirotei"
    cluster: str = ""
    """Name of the cluster in ClickHouse's own configuration; empty for a single node."""
    user: str = "default"
    password_file: str | None = None
    """File that holds the password alone."""
    timeout_s: Annotated[float, Meta(gt=0.0, le=600.0)] = 30.0


class Config(Settings, frozen=True, kw_only=True):
    """Settings of an analyzer."""

    shard: str = "all"
    """Name under which bridges and askers reach it; one analyzer serves one line."""
    store: Literal["duckdb", "clickhouse"] = "duckdb"
    """`duckdb`: embedded, one host; `clickhouse`: a cluster over HTTP."""
    folder: str | None = None
    """Of the embedded store; by default `cloud_analyzer` in the host's state folder."""
    keep_days: Annotated[float, Meta(gt=0.0)] = 400.0
    """Older days are deleted."""
    open_days: Annotated[int, Meta(ge=1, le=60)] = 2
    """So many days stay in the database before they move into day files."""
    threads: Annotated[int, Meta(ge=1, le=256)] = 1
    """Of the embedded store's engine."""
    relays: tuple[str, ...] = ()
    """Places ('demo/wayside/W1') whose bridges may speak for every place of the line; others for their own alone."""
    late_days: Annotated[float, Meta(gt=0.0)] = LATE_DAYS
    """A measurement stamped so long before the bridge heard it is filed under the time at which it was heard."""
    ask_timeout_s: Annotated[float, Meta(gt=0.0, le=600.0)] = 20.0
    """A question that takes longer is refused."""
    learn_daily: bool = True
    """Analyse whole days by the newest radio model, and learn them; otherwise only when asked to."""
    learn_at_hour_utc: Annotated[int, Meta(ge=0, le=23)] = 2
    """When."""
    learn_after_days: Annotated[int, Meta(ge=0, le=60)] = 1
    """A day is learned so long after its end: bridges that were cut off still bring its measurements."""
    learn_days: Annotated[int, Meta(ge=1, le=3650)] = 60
    """The first model is learned from so many days."""
    radio: RadioSettings = RadioSettings()
    """What decides in models that are learned here."""
    clickhouse: ClickHouseSettings = ClickHouseSettings()


@dataclass(slots=True)
class _Work:
    """What the tasks of one analyzer share."""

    node: Node
    config: Config
    store: Store
    ingest: Ingest
    writing: asyncio.Lock = field(default_factory=asyncio.Lock)
    said: deque[tuple[float, int]] = field(default_factory=deque)
    """When an outbox entry was said again, and its number; oldest first."""
    busy: asyncio.Lock = field(default_factory=asyncio.Lock)
    """One piece of work on the history at a time."""
    stopping: bool = False

    async def write(self, work: Callable[[], T]) -> T:
        """Result of work on the store's one writer."""
        async with self.writing:
            return await self.node.in_thread(work)


async def run(node: Node, config: Config) -> None:
    """Answer bridges and askers until stopped."""
    store = await node.in_thread(lambda: open_store(config, node.place.line))
    try:
        ingest = Ingest(node.place.line, await node.in_thread(store.had), frozenset(config.relays), config.late_days)
        work = _Work(node, config, store, ingest)
        set_aside = getattr(store, "set_aside", "")
        if set_aside:
            node.health.set("set_aside", f"the database was damaged and put aside: {set_aside}")
        batches = node.questions(INGEST, shard=config.shard)
        questions = node.questions(STORE, shard=config.shard)
        tasks = node.questions(HISTORY_TASK, shard=config.shard)
        async with asyncio.TaskGroup() as group:
            beside = [
                group.create_task(_tend(work), name="tend"),
                group.create_task(_settle(work), name="settle"),
                group.create_task(_answer(work, questions), name="answers"),
                group.create_task(_work_when_asked(work, tasks), name="tasks"),
                group.create_task(_learn_daily(work), name="learning"),
            ]
            await _say_again(work)
            node.ready()
            await _take(work, batches)
            work.stopping = True
            for task in beside:
                task.cancel()
            await _forget(work, math.inf)
    finally:
        await node.in_thread(store.close)


def open_store(config: Config, line: str) -> Store:
    """The configured store. Raises StoreError."""
    folder = Path(config.folder) if config.folder else state_dir(os.environ) / "cloud_analyzer" / line
    if config.store == "clickhouse":
        there = config.clickhouse
        password = Path(there.password_file).read_text("utf-8").strip() if there.password_file else ""
        nodes = [clickhouse_socket.Node(url, there.user, password, there.timeout_s) for url in there.urls]
        return ClickHouseStore(
            nodes, folder, line=line, database=there.database, cluster=there.cluster, keep_days=config.keep_days
        )
    return DuckDbStore(folder, keep_days=config.keep_days, open_days=config.open_days, threads=config.threads)


async def _say_again(work: _Work) -> None:
    """What was committed before a crash and not said again."""
    for number, records in await work.write(work.store.unpublished):
        for record in records:
            await work.node.publish_mirrored(Sample(record.key, record.payload, record.attachment, record.heard_ns))
        await work.write(partial(work.store.published, number))


async def _take(work: _Work, batches: AsyncIterator[Question[BridgeBatch, BridgeAcknowledgement]]) -> None:
    async for question in batches:
        health = work.node.health
        try:
            taken = work.ingest.take(question.request, work.node.clock.now_ns())
        except (BatchError, ValueError) as error:
            health.refuse(f"{question.source}: {error}", work.node.clock.monotonic_s())
            await question.refuse(str(error))
            continue
        try:
            number = await work.write(partial(work.store.commit, taken.commit))
        except StoreError as error:
            health.count("commits_failed")
            health.trouble("store", str(error), work.node.clock.monotonic_s())
            await question.refuse(f"not taken: {error}")
            continue
        work.ingest.confirm(taken)
        await question.answer(taken.acknowledgement)
        health.count("rows", len(taken.commit.rows))
        if taken.ahead_ns:
            off = f"{question.request.bridge}: its clock is {taken.ahead_ns / 1e9:+.0f} s off"
            health.trouble("clock", off, work.node.clock.monotonic_s())
        health.count("repeated", taken.acknowledgement.repeated)
        if taken.acknowledgement.refused:
            health.count("undecoded", taken.acknowledgement.refused)
            health.trouble("undecoded", str(taken.commit.rows.refused[0][2]), work.node.clock.monotonic_s())
        for record in taken.commit.outbox:
            await work.node.publish_mirrored(Sample(record.key, record.payload, record.attachment, record.heard_ns))
        if taken.commit.outbox:
            work.said.append((work.node.clock.monotonic_s(), number))


async def _answer(work: _Work, questions: AsyncIterator[Question[StoreQuestion, StoreAnswer]]) -> None:
    async for question in questions:
        request = question.request
        try:
            answer = await work.node.in_thread(partial(_page, work, request))
        except (StoreError, ValueError) as error:
            work.node.health.count("questions_refused")
            await question.refuse(str(error))
            continue
        work.node.health.count("questions")
        await question.answer(msgspec.structs.replace(answer, t_ns=work.node.clock.now_ns()))


def _page(work: _Work, request: StoreQuestion) -> StoreAnswer:
    return told(request, work.store.ask(request, work.config.ask_timeout_s))


async def _work_when_asked(work: _Work, questions: AsyncIterator[Question[HistoryTask, HistoryTaskDone]]) -> None:
    async for question in questions:
        try:
            await question.answer(await _work_on(work, question.request))
        except (StoreError, ValueError) as error:
            work.node.health.count("tasks_refused")
            await question.refuse(str(error))


async def _work_on(work: _Work, task: HistoryTask) -> HistoryTaskDone:
    """What came of a task, once it is kept. Raises StoreError, ValueError."""
    node = work.node
    history = HistoryWork(work.store, node.place.line, work.config.radio, lambda: work.stopping)
    async with work.busy:
        done, findings = await node.in_thread(lambda: history.do(task, node.clock.now_ns()))
        await work.write(partial(work.store.keep, findings))
    node.health.count("models", len(findings.models))
    node.health.count("reanalysed", len(findings.reanalysed))
    return done


async def _learn_daily(work: _Work) -> None:
    """At its hour, or after a start that comes later: days that are over, by the newest model, and learned."""
    node, config = work.node, work.config
    learned_day = -1
    while config.learn_daily:
        now_ns = node.clock.now_ns()
        day = (now_ns - config.learn_at_hour_utc * HOUR_NS) // DAY_NS
        if day > learned_day:
            until_ns = (now_ns // DAY_NS - config.learn_after_days) * DAY_NS
            task = HistoryTask(
                t_ns=now_ns, task="update", from_ns=until_ns - config.learn_days * DAY_NS, until_ns=until_ns
            )
            try:
                await _work_on(work, task)
                learned_day = day
                node.health.clear("learning")
            except (StoreError, ValueError) as error:
                # A node that is away comes back: tried again at the next look.
                node.health.set("learning", f"nothing learned today: {error}")
        await asyncio.sleep(LOOK_S)


async def _settle(work: _Work) -> None:
    """Keep what was said until readers have had the time to find its publisher: a crash before says it again."""
    while True:
        await asyncio.sleep(SETTLE_S / 2.0)
        await _forget(work, work.node.clock.monotonic_s() - SETTLE_S)


async def _forget(work: _Work, until_s: float) -> None:
    number = None
    while work.said and work.said[0][0] <= until_s:
        _, number = work.said.popleft()
    if number is not None:
        try:
            await work.write(partial(work.store.published, number))
        except StoreError as error:
            # The next one takes it along; a start says it again at worst.
            work.node.health.trouble("store", str(error), work.node.clock.monotonic_s())


async def _tend(work: _Work) -> None:
    while True:
        try:
            done = await work.write(lambda: work.store.tend(work.node.clock.now_ns()))
            if done:
                work.node.health.count("days_closed")
        except StoreError as error:
            work.node.health.trouble("tend", str(error), work.node.clock.monotonic_s())
        await asyncio.sleep(TEND_S)


SERVICE = Service(
    "cloud_analyzer",
    Config,
    reads=(),
    writes=(),
    run=run,
    about="keeps what trains and wayside sites sent, says it again in the cloud, learns from it, answers questions",
    answers=(INGEST, STORE, HISTORY_TASK),
    mirrors=True,
)
