"""A service's node on a network: sessions of Zenoh behind the port that services know."""

from __future__ import annotations

import asyncio
import secrets
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from functools import partial
from typing import Any, Self, TypeVar

import zenoh

from schemas.codec import encode
from schemas.message import Message
from schemas.queries import RETAINED
from schemas.topic import Delivery, Place, Query, Topic, mirrored_key
from schemas.topics import TABLE, topic_at
from services.runtime.alive import AliveChange, Token, tokens_anywhere
from services.runtime.attachment import Attachment, encode_attachment
from services.runtime.clock import Clock
from services.runtime.health import HealthBoard
from services.runtime.host_config import BusConfig
from services.runtime.inbox import DEFAULT_CAPACITY, Inbox
from services.runtime.node import Node, Sample, Service
from services.runtime.question import Question, answer_of
from services.runtime.retention import Retention
from services.runtime.zenoh_liveliness import AliveWatch, IdentityTakenError, claim, services_alive
from services.runtime.zenoh_publishers import Outlet, Outlets
from services.runtime.zenoh_queries import Asker, Queryable
from services.runtime.zenoh_session import close_session, open_session
from services.runtime.zenoh_subscriptions import Subscription

__all__ = ["IdentityTakenError", "ZenohNode"]

T = TypeVar("T")
EVENT_CAPACITY = 65_536
"""Inbox of a reader of EVENT or KEPT: room for what the publishers of a line have kept for late readers."""
FLUSH_S = 0.8
"""How long closing waits for EVENT and KEPT publications that the link has not taken yet."""
CLOSE_S = 0.7
"""How long it waits for Zenoh itself; together less than a process has for its end."""


class ZenohNode:
    """One service's access to the bus. Make it with `open`, end it with `close`."""

    def __init__(
        self,
        session: zenoh.Session,
        bus: BusConfig,
        service: Service[Any],
        place: Place,
        instance: str,
        clock: Clock,
        boot_id: str,
    ) -> None:
        """Take over an open session. Needs a running loop."""
        self._session = session
        self._bus = bus
        self._service = service
        self.place = place
        self.instance = instance
        self.clock = clock
        self.source = f"{place}/{instance}"
        self.boot_id = boot_id
        self.health = HealthBoard(instance, boot_id, clock.monotonic_s())
        self._ready = asyncio.Event()
        self._stop = asyncio.Event()
        self._outlets = Outlets(session, instance, partial(Outlet, self.source, boot_id, clock), self._note_unsent)
        self._known: dict[tuple[Topic[Any], tuple[tuple[str, str], ...]], Outlet] = {}
        self._retention = Retention(boot_id, bus.retain_s, round(1e6 * bus.retain_mb))
        self._retaining: asyncio.Task[None] | None = None
        self._inboxes: list[Inbox] = []
        self._subscriptions: list[Subscription] = []
        self._watches: list[AliveWatch] = []
        self._queryables: list[Queryable] = []
        self._closing: list[Queryable] = []
        """Those that answer until the end."""
        self._others: list[ZenohNode] = []
        self._asker = Asker(session, instance)
        self._closed = False
        self._token: zenoh.LivelinessToken | None = None

    @classmethod
    async def open(
        cls,
        service: Service[Any],
        place: Place,
        instance: str,
        clock: Clock,
        bus: BusConfig,
        *,
        on_waiting: Callable[[str], None] | None = None,
        announced: bool = True,
    ) -> Self:
        """Node of a service, as soon as a router answers and the service's identity is free.

        `on_waiting` is called after each vain attempt to reach a router, with the reason.
        `announced=False` is for onlookers that may run many times at once, `kirotei watch`: no
        identity, no token. Raises IdentityTakenError, BusConfigError; can be cancelled.
        """
        session = await open_session(bus, on_waiting)
        try:
            own = Token(place, instance, secrets.token_hex(6))
            token = await claim(session, own, clock) if announced else None
            node = cls(session, bus, service, place, instance, clock, own.boot_id)
        except BaseException:
            await asyncio.shield(asyncio.to_thread(close_session, session))
            raise
        node._token = token
        return node

    async def publish(self, topic: Topic[Any], message: Message, **fields: str) -> None:
        """Put a message on its key; see `Node.publish`.

        The first publication on a key declares it, in a thread. Raises NodeClosedError after `close`.
        """
        outlet = self._known.get((topic, tuple(fields.items())))
        if outlet is None:
            self._service.require_write(topic)
            outlet = await self._outlet(topic, topic.at(self.place, **fields))
            self._known[topic, tuple(fields.items())] = outlet
        if type(message) is not outlet.message:
            msg = f"{topic.template} carries {topic.schema_name}, not {type(message).__name__}"
            raise TypeError(msg)
        await self._send(outlet, encode(message))

    async def publish_encoded(self, key: str, payload: bytes) -> None:
        """Put an encoded message on a concrete key, whatever its place; for replays.

        Raises UndeclaredTopicError, TopicError when no topic has the key, and NodeClosedError
        after `close`.
        """
        outlet = self._outlets.known(key)
        if outlet is None:
            topic = topic_at(key)
            self._service.require_write(topic)
            outlet = await self._outlet(topic, key)
        await self._send(outlet, payload)

    async def _outlet(self, topic: Topic[Any], key: str) -> Outlet:
        if topic.delivery is Delivery.KEPT and self._retaining is None:
            self._retaining = asyncio.create_task(self._answer_retained(), name="retained")
        return await self._outlets.at(topic, key)

    async def _send(self, outlet: Outlet, payload: bytes) -> None:
        self.health.published += 1
        if not outlet.waits:
            outlet.put(payload, outlet.mark())
            return
        mark = await self._outlets.send(outlet, payload)
        if outlet.kept:
            self._retention.keep(outlet.key, outlet.sequence - 1, payload, mark, self.clock.monotonic_s())

    async def _answer_retained(self) -> None:
        """Say what is still kept to whoever has missed it, until closed."""
        queryable = Queryable(self._session, RETAINED, RETAINED.at(self.place, service=self.instance), self.health)
        self._closing.append(queryable)
        async for question in queryable.questions():
            answer = self._retention.answer(question.request, self.clock.monotonic_s(), self.clock.now_ns())
            await question.answer(answer)

    async def publish_mirrored(self, sample: Sample) -> None:
        """Say a bridged publication again; see `Node.publish_mirrored`."""
        self._service.require_mirror()
        key = mirrored_key(sample.key)
        outlet = self._outlets.known(key) or await self._outlets.at(topic_at(key), key)
        self.health.published += 1
        if outlet.waits:
            await self._outlets.send(outlet, sample.payload, sample.attachment)
        else:
            outlet.put(sample.payload, sample.attachment)

    def questions(self, query: Query[Any, Any], **fields: str) -> AsyncIterator[Question[Any, Any]]:
        """Questions put to this service; see `Node.questions`."""
        self._service.require_answer(query)
        queryable = Queryable(self._session, query, query.at(self.place, **fields), self.health)
        self._queryables.append(queryable)
        if self._stop.is_set():
            queryable.stop()
        return queryable.questions()

    async def ask(
        self, query: Query[Any, Any], place: Place, request: Message, *, timeout_s: float, **fields: str
    ) -> Any:  # noqa: ANN401 - the query's reply
        """Answer of whoever answers; see `Node.ask`."""
        self._service.require_ask(query)
        key = query.at(place, **fields)
        mark = encode_attachment(Attachment(self.source, self.boot_id, 0, self.clock.now_ns()))
        payload, refused = await self._asker.ask(key, encode(request), mark, timeout_s) or (None, False)
        return answer_of(query, key, payload, refused=refused)

    @asynccontextmanager
    async def elsewhere(self, bus: BusConfig) -> AsyncIterator[Node]:
        """Access to another router; see `Node.elsewhere`."""
        session = await open_session(
            bus, lambda reason: self.health.trouble("elsewhere", reason, self.clock.monotonic_s())
        )
        node = type(self)(session, bus, self._service, self.place, self.instance, self.clock, self.boot_id)
        node.health = self.health
        if self._stop.is_set():
            node.stop()
        self._others.append(node)
        try:
            yield node
        finally:
            self._others.remove(node)
            await node.close()

    def arrivals(self, *topics: Topic[Any], anywhere: bool = False, mirrored: bool = False) -> AsyncIterator[Any]:
        """Messages with their senders; see `Node.arrivals`."""
        return self._read(topics, anywhere=anywhere, mirrored=mirrored).arrivals(TABLE)

    def messages(self, *topics: Topic[Any]) -> AsyncIterator[Any]:
        """Messages alone; see `Node.messages`."""
        return self._read(topics, anywhere=False).messages(TABLE)

    def _read(self, topics: tuple[Topic[Any], ...], *, anywhere: bool, mirrored: bool = False) -> Inbox:
        for topic in topics:
            self._service.require_read(topic)
        lossless = any(topic.delivery in (Delivery.EVENT, Delivery.KEPT) for topic in topics)
        inbox = self._open_inbox(EVENT_CAPACITY if lossless else DEFAULT_CAPACITY)
        for topic in topics:
            widely = anywhere or mirrored
            expression = topic.anywhere(self.place.line, mirrored=mirrored) if widely else topic.within(self.place)
            self._subscribe(expression, inbox, topic.delivery)
        return inbox

    def samples(self, key_expression: str) -> AsyncIterator[Sample]:
        """Undecoded publications; see `Node.samples`."""
        inbox = self._open_inbox(EVENT_CAPACITY)
        self._subscribe(key_expression, inbox, None)
        return inbox.samples()

    def _open_inbox(self, capacity: int) -> Inbox:
        # Readers come and go in a service that serves people; what has ended is let go of here.
        self._inboxes = [inbox for inbox in self._inboxes if not inbox.closed]
        self._subscriptions = [subscription for subscription in self._subscriptions if not subscription.ended]
        inbox = Inbox(self.clock, self.health, capacity)
        self._inboxes.append(inbox)
        if self._stop.is_set():
            inbox.close()
        return inbox

    def _subscribe(self, expression: str, inbox: Inbox, delivery: Delivery | None) -> None:
        # What a STATE publisher no longer has was replaced by something newer: no loss.
        loss = delivery in (Delivery.EVENT, Delivery.KEPT)
        subscription = Subscription(
            self._session,
            expression,
            inbox,
            self.clock.now_ns,
            recovers=delivery is not Delivery.STREAM,
            on_miss=(lambda count: inbox.count_lost(expression, count)) if loss else None,
        )
        self._subscriptions.append(subscription)

    async def services_alive(self, line: str = "*") -> set[str]:
        """Services that live now, as `source` stands in attachments. Takes a round trip, at most two seconds."""
        return {token.service for token in await services_alive(self._bus, line)}

    def watch_alive(self, line: str = "*") -> AsyncIterator[AliveChange]:
        """Services as they appear and are lost (after five seconds without token), until stopped."""
        watch = AliveWatch(self._session, tokens_anywhere(line), self.clock)
        self._watches.append(watch)
        if self._stop.is_set():
            watch.close()
        return watch.changes()

    def ready(self) -> None:
        """Note that the service answers from now on."""
        self._ready.set()

    async def wait_ready(self) -> None:
        """Wait until the service has said that it is ready."""
        await self._ready.wait()

    @property
    def stopping(self) -> bool:
        """True once `stop` was called."""
        return self._stop.is_set()

    def stop(self) -> None:
        """Ask the service to finish: its readers end after what is queued."""
        self._stop.set()
        for inbox in self._inboxes:
            inbox.close()
        for watch in self._watches:
            watch.close()
        for queryable in self._queryables:
            queryable.stop()
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
        """Result of blocking work, off the loop."""
        return await asyncio.to_thread(work)

    def _note_unsent(self, reason: str) -> None:
        self.health.count("unsent")
        self.health.trouble("unsent", f"not sent: {reason}", self.clock.monotonic_s())

    async def close(self) -> int:
        """End every subscription and the session; the number of publications that could not be sent.

        Takes at most one second and a half, however stuck the link is.
        """
        if self._closed:
            return 0
        self._closed = True
        self.stop()
        self._known.clear()
        self._outlets.refuse_more()
        if self._retaining is not None:
            self._retaining.cancel()
        self._asker.close()
        unsent = 0
        done = asyncio.Event()
        loop = asyncio.get_running_loop()

        def end() -> None:
            nonlocal unsent
            unsent = self._outlets.finish(FLUSH_S)
            for queryable in (*self._queryables, *self._closing):
                queryable.close()
            for subscription in self._subscriptions:
                subscription.close(CLOSE_S)
            close_session(self._session)
            with suppress(RuntimeError):  # the loop has ended: nobody waited that long
                loop.call_soon_threadsafe(done.set)

        # A thread that may be left behind: a stuck link must not hold up the interpreter's end.
        threading.Thread(target=end, name=f"{self.instance}-close", daemon=True).start()
        with suppress(TimeoutError):
            async with asyncio.timeout(FLUSH_S + CLOSE_S):
                await done.wait()
        if unsent:
            self.health.count("unsent", unsent)
        return unsent
