"""Everything that must reach the cloud, kept on disk until it has; and what the cloud sends, said again here."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from schemas.bridge import BridgeAcknowledgement, BridgeBatch, BridgedRecord, Document
from schemas.codec import DecodeError, decode
from schemas.queries import INGEST, RETAINED
from schemas.topic import Place, TopicError
from schemas.topics import BRIDGE_STATUS, DOCUMENT, topic_of
from services.lte_bridge.batch import CHUNK_RECORDS, BatchError
from services.lte_bridge.cutting import Cut
from services.lte_bridge.document_store import DocumentError, keep
from services.lte_bridge.exchange import Turns, acknowledgement_of, batch_of, fault_of
from services.lte_bridge.introduction import Introductions
from services.lte_bridge.journal_store import Journal, JournalFaultError, Unsaid
from services.lte_bridge.lane import KEPT, LANES, Lane, lane_of
from services.lte_bridge.pace import Meter, Pace, paces
from services.lte_bridge.pending import Pending
from services.lte_bridge.settings import Far, Settings
from services.lte_bridge.spool_store import Spool, SpoolFaultError
from services.lte_bridge.telling import Progress, counts
from services.runtime.catching_up import CatchingUp
from services.runtime.continuity import Continuity
from services.runtime.host_config import BusConfig
from services.runtime.node import Node, Sample, Service
from services.runtime.question import NoAnswerError, RefusedError
from services.runtime.state_dir import state_dir

MEGABYTE = 1_000_000
STATUS_S = 1.0
DISK_RETRY_S = 1.0
SETTLE_S = 5.0
"""What was said so long ago has left this process, and its readers have found it."""


class Config(Settings, frozen=True, kw_only=True):
    """Settings of a bridge."""

    uplink: BusConfig | None = None
    """The far end's router; left out where the far end comes to this one's."""


async def run(node: Node, config: Config) -> None:
    """Bridge until stopped. Raises SpoolInUseError, and OSError when the folder cannot be made."""
    folder = _folder(node, config)
    async with AsyncExitStack() as stack:
        if config.receives:
            receiver = Receiver(node, config, Journal(folder / "journal.sqlite"), folder / "documents")
            await node.in_thread(receiver.journal.open)
            stack.push_async_callback(node.in_thread, receiver.journal.close)
        if config.far is not None:
            sender = Sender(node, config, config.far, Spool(folder, round(config.cap_mb * MEGABYTE)))
            await node.in_thread(sender.spool.open)
            stack.push_async_callback(node.in_thread, sender.spool.close)
        taken = [node.samples(expression) for expression in config.expressions(node.place)] if config.far else []
        node.ready()
        async with asyncio.TaskGroup() as tasks:
            linked = [tasks.create_task(_with_link(node, config, receiver.receive))] if config.receives else []
            linked += [tasks.create_task(work()) for work in (receiver.say, receiver.settle)] if config.receives else []
            linked += [tasks.create_task(_with_link(node, config, sender.send))] if config.far else []
            linked += [tasks.create_task(sender.tell())] if config.far else []
            if config.far is not None:
                await sender.take(taken)
            while await node.sleep(3600.0):
                pass
            for task in linked:
                task.cancel()


def _folder(node: Node, config: Config) -> Path:
    return Path(config.folder).expanduser() if config.folder else state_dir(os.environ) / "bridge" / node.instance


async def _with_link(node: Node, config: Config, work: Callable[[Node], Awaitable[None]]) -> None:
    """Work on the far end's router, or on this one where the far end comes to us."""
    if config.uplink is None:
        await work(node)
        return
    async with node.elsewhere(config.uplink) as link:
        await work(link)


@dataclass(slots=True)
class Sender:
    """From this bus to the disk, and from there to the far end."""

    node: Node
    config: Config
    far: Far
    spool: Spool
    pending: Pending = field(init=False)
    progress: Progress = field(init=False)
    meter: Meter = field(init=False)
    paces: dict[Lane, Pace] = field(init=False)
    turns: Turns = field(default_factory=Turns)
    _some: asyncio.Event = field(default_factory=asyncio.Event)
    _many: asyncio.Event = field(default_factory=asyncio.Event)
    _changed: asyncio.Event = field(default_factory=asyncio.Event)

    def __post_init__(self) -> None:
        """Begin with nothing known about the link."""
        limit = self.config.rate_limit_kbps
        self.pending = Pending(round(self.config.buffer_mb * MEGABYTE))
        self.progress = Progress(self.node.clock.monotonic_s())
        self.meter = Meter(None if limit is None else 1000.0 * limit)
        self.paces = paces(self.config, f"{self.node.place}/{self.node.instance}")

    async def take(self, taken: list[AsyncIterator[Sample]]) -> None:
        """Everything that is heard to the disk, until the node stops."""
        continuity = Continuity(self.spool.newest_heard, told=not self.spool.new)
        wants = partial(self.config.takes_key, self.node.place)
        reader = CatchingUp(self.node, continuity, wants, self._collect, self._room)
        async with asyncio.TaskGroup() as tasks:
            storing = tasks.create_task(self._store(), name="store")
            await reader.run(taken)
            storing.cancel()
        with suppress(SpoolFaultError):
            await self._put()
        if self.pending.records:
            self.node.health.count("unspooled", len(self.pending.records))

    def _collect(self, sample: Sample) -> None:
        self.node.health.received += 1
        lane = lane_of(sample.key)
        if lane is None:
            self.node.health.count("passed_over")
            return
        record = BridgedRecord(
            key=sample.key, payload=sample.payload, attachment=sample.attachment, heard_ns=sample.received_ns
        )
        self.pending.add(lane, record)
        self._some.set()
        if len(self.pending.records) >= CHUNK_RECORDS:
            self._many.set()

    async def _room(self) -> None:
        """Return when more may come at once."""
        while self.pending.crowded:
            await self._changed.wait()

    async def _store(self) -> None:
        while True:
            await self._some.wait()
            with suppress(TimeoutError):
                async with asyncio.timeout(self.config.commit_s):
                    await self._many.wait()
            self._some.clear()
            self._many.clear()
            try:
                await self._put()
            except SpoolFaultError as error:
                reason = f"nothing can be spooled, {len(self.pending.records)} records wait in memory: {error}"
                self.node.health.set("disk", reason, "failed")
                self._some.set()
                await asyncio.sleep(DISK_RETRY_S)
            else:
                self.node.health.clear("disk")

    async def _put(self) -> None:
        """What waits in memory to the disk; the disk has it also when this is cancelled meanwhile."""
        records, dropped = list(self.pending.records), dict(self.pending.dropped)
        await self.node.in_thread(partial(self.spool.put, records, dropped))
        self.pending.taken(len(records), dropped)
        self._wake()

    def _wake(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()
        while self.spool.notes:
            self.node.health.trouble("spool", self.spool.notes.pop(0), self.node.clock.monotonic_s())

    async def send(self, link: Node) -> None:
        """Everything that waits to the far end, events first, for ever."""
        async with asyncio.TaskGroup() as tasks:
            for lane in LANES:
                tasks.create_task(self._send_lane(lane, link), name=lane)

    async def _send_lane(self, lane: Lane, link: Node) -> None:
        clock, spool = self.node.clock, self.spool
        while True:
            while not self.turns.may_go(lane, spool.waiting(), spool.newest()):
                await self._changed.wait()
            if (wait_s := self.meter.wait_s(clock.monotonic_s())) > 0.0:
                await asyncio.sleep(wait_s)
                continue
            most = min(self.paces[lane].batch_bytes, self.meter.most_bytes(self.config.batch_s))
            try:
                cut = await self.node.in_thread(partial(spool.cut, lane, most))
                pause_s = 0.0 if cut is None else await self._send_cut(lane, link, cut)
            except SpoolFaultError as error:
                self.node.health.trouble("spool", str(error), clock.monotonic_s())
                pause_s = DISK_RETRY_S
            if pause_s:
                self.turns.pauses(lane, pausing=True)
                self._wake()
                await asyncio.sleep(pause_s)
                self.turns.pauses(lane, pausing=False)

    async def _send_cut(self, lane: Lane, link: Node, cut: Cut) -> float:
        """One batch to the far end, and what its answer says; how long to pause then [s]."""
        clock, pace = self.node.clock, self.paces[lane]
        bridge = f"{self.node.place}/{self.node.instance}"
        batch = batch_of(cut, bridge, lane, self.spool.dropped(lane), clock.now_ns())
        self.turns.goes(lane, cut.last)
        self._wake()
        began_s = clock.monotonic_s()
        self.meter.sent(len(cut.compressed), began_s)
        place = Place(self.node.place.line, self.far.kind, self.far.name)
        try:
            answer = await link.ask(INGEST, place, batch, timeout_s=pace.patience_s, shard=self.far.shard)
        except NoAnswerError as error:
            self.node.health.count("unanswered")
            self.progress.faults[lane] = str(error)
            return pace.unanswered(clock.monotonic_s() - began_s)
        except RefusedError as error:
            self.node.health.count("refused_batches")
            self.progress.faults[lane] = f"the far end refused: {error}"
            return pace.refused()
        fault = fault_of(batch, answer)
        if fault is not None:
            self.progress.faults[lane] = fault
            return pace.refused()
        now_s = clock.monotonic_s()
        pace.acknowledged(len(cut.compressed), now_s - began_s)
        gone = await self.node.in_thread(partial(self.spool.acknowledge, lane, answer.through))
        self.progress.succeeded(lane, gone, (clock.now_ns() - cut.newest_ns) / 1e9, now_s)
        self._wake()
        return 0.0

    async def tell(self) -> None:
        """Backlog, delay and losses once a second, for ever."""
        clock, board = self.node.clock, self.node.health
        while True:
            held = await self.node.in_thread(self.spool.held)
            told = self.progress.status(held, self.pending.dropped, clock.now_ns(), clock.monotonic_s())
            board.counts |= counts(told)
            for name, reason in self.progress.reasons(held, told, clock.monotonic_s()).items():
                if reason is None:
                    board.clear(name)
                else:
                    board.set(name, reason[1], reason[0])
            await self.node.publish(BRIDGE_STATUS, told, bridge=self.node.instance)
            with suppress(SpoolFaultError):
                await self.node.in_thread(self.spool.tidy)
            await asyncio.sleep(STATUS_S)


@dataclass(slots=True)
class Receiver:
    """From the far end to the disk, and from there to this bus under mirrored keys."""

    node: Node
    config: Config
    journal: Journal
    documents: Path
    introductions: Introductions = field(default_factory=Introductions)
    _changed: asyncio.Event = field(default_factory=asyncio.Event)

    async def receive(self, link: Node) -> None:
        """Acknowledge every batch once it is durable, for ever."""
        async for question in link.questions(INGEST, shard=self.config.shard):
            answer = await self._take(question.request)
            if isinstance(answer, str):
                await question.refuse(answer)
            else:
                await question.answer(answer)

    async def _take(self, batch: BridgeBatch) -> BridgeAcknowledgement | str:
        """Acknowledgement, or why there is none."""
        clock, board = self.node.clock, self.node.health
        if self.journal.unsaid_bytes > self.config.journal_mb * MEGABYTE:
            return f"{self.journal.unsaid_bytes} bytes wait here to be said again: try later"
        try:
            taken = await self.node.in_thread(partial(self.journal.take, batch))
        except BatchError as error:
            board.refuse(f"batch {batch.first} of {batch.bridge}: {error}", clock.monotonic_s())
            return str(error)
        except JournalFaultError as error:
            board.set("journal", f"nothing can be received: {error}", "failed")
            return f"the far end's disk: {error}"
        board.clear("journal")
        for name, amount in (("taken", taken.fresh), ("repeated", taken.repeated), ("refused_records", taken.refused)):
            board.count(name, amount)
        while self.journal.notes:
            board.trouble("journal", self.journal.notes.pop(0), clock.monotonic_s())
        self._changed.set()
        return acknowledgement_of(batch, taken.through, taken.repeated, taken.refused, clock.now_ns())

    async def say(self) -> None:
        """What was received under its mirrored keys, in order, for ever."""
        while True:
            self._changed.clear()
            try:
                unsaid = await self.node.in_thread(self.journal.next_unsaid)
                if unsaid is None:
                    await self._changed.wait()
                    continue
                refused = await self._say(unsaid)
                if refused:
                    await self.node.in_thread(partial(self.journal.refuse, refused))
                self.journal.said(unsaid)
            except (JournalFaultError, OSError) as error:
                self.node.health.trouble("say", f"not said again yet: {error}", self.node.clock.monotonic_s())
                await asyncio.sleep(DISK_RETRY_S)

    async def settle(self) -> None:
        """Let go of what has been said for a while, for ever."""
        while True:
            await asyncio.sleep(SETTLE_S)
            with suppress(JournalFaultError):  # told when something is to be received
                await self.node.in_thread(self.journal.settle)

    async def _say(self, unsaid: Unsaid) -> list[tuple[BridgedRecord, str]]:
        """Records that cannot be said, with the reasons."""
        refused: list[tuple[BridgedRecord, str]] = []
        clock, introductions = self.node.clock, self.introductions
        for record in introductions.order(unsaid.records):
            if (wait_s := introductions.wait_s(record.key, clock.monotonic_s())) > 0.0:
                await asyncio.sleep(wait_s)
            try:
                if (address := topic_of(record.key)) is not None and address.topic is DOCUMENT:
                    await self.node.in_thread(partial(keep, self.documents, decode(Document, record.payload)))
                sample = Sample(record.key, record.payload, record.attachment, record.heard_ns)
                await self.node.publish_mirrored(sample)
                introductions.said(record.key, clock.monotonic_s())
            except (TopicError, DecodeError, DocumentError) as error:
                refused.append((record, str(error)))
                self.node.health.refuse(f"{record.key}: {error}", clock.monotonic_s())
        return refused


SERVICE = Service(
    "lte_bridge",
    Config,
    reads=KEPT,
    writes=(BRIDGE_STATUS,),
    run=run,
    about="keeps what must reach the cloud on disk until it has, and says again what the cloud sends",
    answers=(INGEST,),
    asks=(INGEST, RETAINED),
    mirrors=True,
)
