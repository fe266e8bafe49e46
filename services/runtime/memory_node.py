"""The bus inside one process: for tests and offline replay, with deliveries as on the network.

Delivery is immediate and in order; nothing is lost but by a full inbox. Late readers get the
last STATE of each key and the last thousand EVENT and KEPT publications.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any, TypeVar

from msgspec import Struct

from schemas.codec import encode
from schemas.message import Message
from schemas.retention import RetainedQuestion
from schemas.topic import Delivery, Place, Query, Topic, TopicError, TopicTable, mirrored_key
from schemas.topics import TABLE
from services.runtime.attachment import Attachment, encode_attachment
from services.runtime.clock import Clock
from services.runtime.health import HealthBoard
from services.runtime.host_config import BusConfig
from services.runtime.inbox import DEFAULT_CAPACITY, Inbox
from services.runtime.key_expression import intersects
from services.runtime.node import Node, Sample, Service
from services.runtime.question import Question, answer_of
from services.runtime.retention import Retention

T = TypeVar("T")
EVENT_CACHE = 1000
LOOK_AGAIN_S = 1.0
"""How often a router that does not answer is tried."""
Waiting = tuple[Any, str, "asyncio.Future[tuple[bytes, bool]]"]
"""A request, who asks, and where the answer goes."""


class MemoryBus:
    """Hands every publication to every inbox whose key expression matches."""

    def __init__(self, table: TopicTable = TABLE, on_publish: Callable[[Sample], None] | None = None) -> None:
        """Make an empty bus with the given topics. `on_publish` hears what nodes publish, not what is `put`."""
        self.table = table
        self._on_publish = on_publish
        self._inboxes: list[tuple[tuple[str, ...], Inbox]] = []
        self._state: dict[str, Sample] = {}
        self._events: deque[Sample] = deque(maxlen=EVENT_CACHE)
        self._boots: dict[str, int] = {}
        self._matches: dict[str, list[Inbox]] = {}
        self.asked: dict[str, asyncio.Queue[Waiting | None]] = {}
        """Questions by the key at which somebody answers."""
        self.others: dict[str, MemoryBus] = {}
        """Buses of other routers by endpoint, for `Node.elsewhere`."""
        self.alive: set[str] = set()
        """Sources of nodes that have not been stopped."""
        self.retentions: dict[str, Retention] = {}
        """What nodes keep, by source."""
        self.cut = False
        """Questions get no answer, as over a link that swallows everything."""

    def other(self, endpoints: tuple[str, ...]) -> MemoryBus | None:
        """Bus of the first router of these that there is."""
        return next((self.others[one] for one in endpoints if one in self.others), None)

    def boot_id(self, source: str) -> str:
        """Next boot id of a source: 'boot-1', 'boot-2', … (reproducible, unlike the network's)."""
        self._boots[source] = self._boots.get(source, 0) + 1
        return f"boot-{self._boots[source]}"

    def publish(self, sample: Sample, delivery: Delivery) -> None:
        """Deliver one publication of a node."""
        if self._on_publish is not None:
            self._on_publish(sample)
        self.put(sample, delivery)

    def put(self, sample: Sample, delivery: Delivery) -> None:
        """Deliver one publication that comes from elsewhere."""
        if delivery is Delivery.STATE:
            self._state[sample.key] = sample
        elif delivery in (Delivery.EVENT, Delivery.KEPT):
            self._events.append(sample)
        inboxes = self._matches.get(sample.key)
        if inboxes is None:
            inboxes = [inbox for expressions, inbox in self._inboxes if _matches(expressions, sample.key)]
            self._matches[sample.key] = inboxes
        for inbox in inboxes:
            inbox.put_inline(sample)

    def subscribe(self, expressions: tuple[str, ...], inbox: Inbox) -> None:
        """Deliver to `inbox` from now on, after what late readers get."""
        self._inboxes.append((expressions, inbox))
        self._matches.clear()
        for sample in (*self._state.values(), *self._events):
            if _matches(expressions, sample.key):
                inbox.put_inline(sample)

    def unsubscribe(self, inbox: Inbox) -> None:
        """Deliver to `inbox` no more."""
        self._inboxes = [entry for entry in self._inboxes if entry[1] is not inbox]
        self._matches.clear()


def _matches(expressions: tuple[str, ...], key: str) -> bool:
    return any(intersects(expression, key) for expression in expressions)


class MemoryNode:
    """A service's node on a MemoryBus."""

    def __init__(
        self,
        bus: MemoryBus,
        service: Service[Any],
        place: Place,
        clock: Clock,
        instance: str | None = None,
        capacity: int = DEFAULT_CAPACITY,
    ) -> None:
        """Join the bus. Needs a running loop."""
        self._bus = bus
        self._service = service
        self._capacity = capacity
        self.place = place
        self.instance = instance or service.name
        self.clock = clock
        self.source = f"{place}/{self.instance}"
        self.boot_id = bus.boot_id(self.source)
        self.health = HealthBoard(self.instance, self.boot_id, clock.monotonic_s())
        self.is_ready = asyncio.Event()
        self._stop = asyncio.Event()
        self._sequences: dict[str, int] = {}
        self._inboxes: list[Inbox] = []
        self._answering: list[str] = []
        self._others: list[MemoryNode] = []
        self._retention = Retention(self.boot_id, BusConfig().retain_s, round(1e6 * BusConfig().retain_mb))
        bus.alive.add(self.source)

    async def publish(self, topic: Topic[Any], message: Message, **fields: str) -> None:
        """Put a message on its key; see `Node.publish`."""
        self._service.require_write(topic)
        if type(message) is not topic.message:
            msg = f"{topic.template} carries {topic.schema_name}, not {type(message).__name__}"
            raise TypeError(msg)
        self._send(topic.at(self.place, **fields), encode(message), topic.delivery)

    async def publish_encoded(self, key: str, payload: bytes) -> None:
        """Put an encoded message on a concrete key, whatever its place; for replays.

        Raises UndeclaredTopicError, and TopicError when no topic has the key.
        """
        address = self._bus.table.find(key)
        if address is None:
            msg = f"no topic has the key {key}"
            raise TopicError(msg)
        self._service.require_write(address.topic)
        self._send(key, payload, address.topic.delivery)

    def _send(self, key: str, payload: bytes, delivery: Delivery) -> None:
        sequence = self._sequences.get(key, 0)
        self._sequences[key] = sequence + 1
        now_ns = self.clock.now_ns()
        attachment = encode_attachment(Attachment(self.source, self.boot_id, sequence, now_ns))
        self.health.published += 1
        if delivery is Delivery.KEPT:
            self._bus.retentions.setdefault(self.source, self._retention)
            self._retention.keep(key, sequence, payload, attachment, self.clock.monotonic_s())
        self._bus.publish(Sample(key, payload, attachment, now_ns), delivery)

    async def publish_mirrored(self, sample: Sample) -> None:
        """Say a bridged publication again; see `Node.publish_mirrored`."""
        self._service.require_mirror()
        key = mirrored_key(sample.key)
        address = self._bus.table.find(key)
        if address is None:
            msg = f"no topic has the key {key}"
            raise TopicError(msg)
        self.health.published += 1
        again = Sample(key, sample.payload, sample.attachment, self.clock.now_ns())
        self._bus.publish(again, address.topic.delivery)

    def questions(self, query: Query[Any, Any], **fields: str) -> AsyncIterator[Question[Any, Any]]:
        """Questions put to this service; see `Node.questions`."""
        self._service.require_answer(query)
        key = query.at(self.place, **fields)
        waiting = self._bus.asked.setdefault(key, asyncio.Queue())
        self._answering.append(key)
        return self._questions(query, key, waiting)

    async def _questions(
        self, query: Query[Any, Any], key: str, waiting: asyncio.Queue[Waiting | None]
    ) -> AsyncIterator[Question[Any, Any]]:
        while not self._stop.is_set() and (asked := await waiting.get()) is not None:
            request, source, first = asked

            async def send(payload: bytes, refused: bool, first: asyncio.Future[Any] = first) -> None:  # noqa: FBT001 - the port's form
                if not first.done():
                    first.set_result((payload, refused))

            yield Question(request, key, source, query.reply, send)

    async def ask(
        self, query: Query[Any, Any], place: Place, request: Message, *, timeout_s: float, **fields: str
    ) -> Any:  # noqa: ANN401 - the query's reply
        """Answer of whoever answers; see `Node.ask`."""
        self._service.require_ask(query)
        key = query.at(place, **fields)
        if isinstance(request, RetainedQuestion):
            retention = self._bus.retentions.get(f"{place}/{fields['service']}")
            if retention is not None:
                return retention.answer(request, self.clock.monotonic_s(), self.clock.now_ns())
        if key not in self._bus.asked and not self._bus.cut:
            return answer_of(query, key, None, refused=False)
        first: asyncio.Future[tuple[bytes, bool]] = asyncio.get_running_loop().create_future()
        if not self._bus.cut:
            self._bus.asked[key].put_nowait((request, self.source, first))
        try:
            async with asyncio.timeout(timeout_s):
                payload, refused = await first
        except TimeoutError:
            return answer_of(query, key, None, refused=False)
        # The answer may have been on its way when the link went.
        return answer_of(query, key, None if self._bus.cut else payload, refused=refused)

    async def services_alive(self, line: str = "*") -> set[str]:
        """Services that live now; see `Node.services_alive`."""
        return {source for source in self._bus.alive if line in ("*", source.split("/", 1)[0])}

    @asynccontextmanager
    async def elsewhere(self, bus: BusConfig) -> AsyncIterator[Node]:
        """Access to another router; see `Node.elsewhere`."""
        while (other := self._bus.other(bus.connect)) is None:  # noqa: ASYNC110 - asks again, as the network's node does
            await asyncio.sleep(LOOK_AGAIN_S)
        node = MemoryNode(other, self._service, self.place, self.clock, self.instance, self._capacity)
        node.boot_id, node.health = self.boot_id, self.health
        if self._stop.is_set():
            node.stop()
        self._others.append(node)
        try:
            yield node
        finally:
            self._others.remove(node)
            node.stop()

    def arrivals(self, *topics: Topic[Any], anywhere: bool = False, mirrored: bool = False) -> AsyncIterator[Any]:
        """Messages with their senders; see `Node.arrivals`."""
        return self._read(topics, anywhere=anywhere, mirrored=mirrored).arrivals(self._bus.table)

    def messages(self, *topics: Topic[Any]) -> AsyncIterator[Any]:
        """Messages alone; see `Node.messages`."""
        return self._read(topics, anywhere=False).messages(self._bus.table)

    def samples(self, key_expression: str) -> AsyncIterator[Sample]:
        """Undecoded publications; see `Node.samples`."""
        return self._open_inbox((key_expression,)).samples()

    def _read(self, topics: tuple[Topic[Any], ...], *, anywhere: bool, mirrored: bool = False) -> Inbox:
        for topic in topics:
            self._service.require_read(topic)
        widely = anywhere or mirrored
        return self._open_inbox(
            tuple(
                topic.anywhere(self.place.line, mirrored=mirrored) if widely else topic.within(self.place)
                for topic in topics
            )
        )

    def _open_inbox(self, expressions: tuple[str, ...]) -> Inbox:
        inbox = Inbox(self.clock, self.health, self._capacity)
        self._inboxes.append(inbox)
        self._bus.subscribe(expressions, inbox)
        if self._stop.is_set():
            inbox.close()
        return inbox

    def ready(self) -> None:
        """Note that the service answers from now on."""
        self.is_ready.set()

    @property
    def stopping(self) -> bool:
        """True once `stop` was called."""
        return self._stop.is_set()

    def stop(self) -> None:
        """Ask the service to finish: its readers end after what is queued."""
        self._stop.set()
        self._bus.alive.discard(self.source)
        self._bus.retentions.pop(self.source, None)
        for inbox in self._inboxes:
            self._bus.unsubscribe(inbox)
            inbox.close()
        for key in self._answering:
            waiting = self._bus.asked.pop(key, None)
            if waiting is not None:
                waiting.put_nowait(None)
        for other in self._others:
            other.stop()

    async def sleep(self, seconds: float) -> bool:
        """Wait; see `Node.sleep`."""
        try:
            async with asyncio.timeout(seconds):
                await self._stop.wait()
        except TimeoutError:
            return not self._stop.is_set()
        return False

    async def in_thread(self, work: Callable[[], T]) -> T:
        """Result of `work`, inline: time is virtual here."""
        return work()

    async def run(self, config: Struct) -> None:
        """Run the service until it ends."""
        await self._service.run(self, config)
