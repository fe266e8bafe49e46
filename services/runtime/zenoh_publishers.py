"""How each delivery goes out: publishers, and the thread for what may have to wait."""

from __future__ import annotations

import asyncio
import queue
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Protocol

import zenoh
from zenoh import CongestionControl, Reliability, ext

from schemas.message import Message
from schemas.topic import Delivery, Topic
from services.runtime.attachment import Attachment, encode_attachment
from services.runtime.clock import Clock

EVENT_CACHE = 1000
"""Publications of one key kept for late and cut-off readers: rate times the longest outage that is bridged."""
HEARTBEAT_S = 0.5
"""How soon a reader learns that the last publication was lost, when no other follows it."""
QUEUE_CAPACITY = 1000
"""EVENT and KEPT publications of one service that may wait for the link."""


class NodeClosedError(RuntimeError):
    """A service publishes after its node was closed."""


class ZenohPublisher(Protocol):
    """What plain and advanced publishers have in common."""

    def put(self, payload: bytes, *, attachment: bytes) -> None:
        """Publish."""


class Outlet:
    """One key of one service, ready to be published on. Used from the loop's thread."""

    __slots__ = ("_boot_id", "_clock", "_publisher", "_source", "kept", "key", "message", "sequence", "waits")

    def __init__(
        self, source: str, boot_id: str, clock: Clock, publisher: ZenohPublisher, topic: Topic[Message], key: str
    ) -> None:
        """Start counting at 0."""
        self.key = key
        self.message = topic.message
        self.kept = topic.delivery is Delivery.KEPT
        self.waits = self.kept or topic.delivery is Delivery.EVENT
        self.sequence = 0
        self._publisher = publisher
        self._source = source
        self._boot_id = boot_id
        self._clock = clock

    def mark(self) -> bytes:
        """Attachment of the next publication."""
        mark = Attachment(self._source, self._boot_id, self.sequence, self._clock.now_ns())
        self.sequence += 1
        return encode_attachment(mark)

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Hand over to Zenoh. Raises ZError when the session is closed."""
        self._publisher.put(payload, attachment=attachment)


def declare(session: zenoh.Session, topic: Topic[Message], key: str) -> ZenohPublisher:
    """Publisher that keeps the promise of the topic's delivery."""
    encoding = zenoh.Encoding("application/msgpack").with_schema(topic.schema_name)
    if topic.delivery is Delivery.STREAM:
        return session.declare_publisher(
            key, encoding=encoding, congestion_control=CongestionControl.DROP, express=True
        )
    # Sporadic: a heartbeat only after something was published.
    misses = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S)
    if topic.delivery is Delivery.STATE:
        return ext.declare_advanced_publisher(
            session,
            key,
            encoding=encoding,
            congestion_control=CongestionControl.DROP,
            reliability=Reliability.RELIABLE,
            cache=ext.CacheConfig(1),
            sample_miss_detection=misses,
            publisher_detection=True,
        )
    replies = ext.RepliesConfig(congestion_control=CongestionControl.BLOCK)
    return ext.declare_advanced_publisher(
        session,
        key,
        encoding=encoding,
        congestion_control=CongestionControl.BLOCK,
        reliability=Reliability.RELIABLE,
        cache=ext.CacheConfig(EVENT_CACHE, replies_config=replies),
        sample_miss_detection=misses,
        publisher_detection=True,
    )


class Sender:
    """One thread that publishes what may block, in order, from a bounded queue.

    A blocking put waits up to five seconds on a link that is stuck: never on the loop.
    """

    def __init__(self, name: str, on_failure: Callable[[str], None], capacity: int = QUEUE_CAPACITY) -> None:
        """Start the thread. `on_failure` is called on the running loop with what could not be sent, and why."""
        self._loop = asyncio.get_running_loop()
        self._queue: queue.SimpleQueue[tuple[Outlet, bytes, bytes] | None] = queue.SimpleQueue()
        self._capacity = capacity
        self._on_failure = on_failure
        self._room_wanted = False
        self._room = asyncio.Event()
        self._finishing = False
        self._abandoned = False
        self._thread = threading.Thread(target=self._run, name=f"{name}-sender", daemon=True)
        self._thread.start()

    async def send(self, outlet: Outlet, payload: bytes, attachment: bytes | None = None) -> bytes:
        """Queue one publication; waits while the queue is full. Publications of one key keep their order.

        Marked as the outlet's next unless it comes with an attachment of its own; returns the attachment,
        without giving up its turn between the two.

        Raises NodeClosedError once the node is being closed.
        """
        while self._queue.qsize() >= self._capacity and not self._finishing:
            self._room.clear()
            self._room_wanted = True
            if self._queue.qsize() >= self._capacity:  # again, for the thread may have missed the wish
                await self._room.wait()
        if self._finishing:
            msg = f"nothing more goes out on {outlet.key}: the node is closed"
            raise NodeClosedError(msg)
        mark = outlet.mark() if attachment is None else attachment
        self._queue.put((outlet, payload, mark))
        return mark

    def refuse_more(self) -> None:
        """Let everyone who waits in `send`, or will, have NodeClosedError. On the loop, before `finish`."""
        self._finishing = True
        self._room.set()

    def finish(self, timeout_s: float) -> int:
        """Send what is queued; number of publications given up when that takes longer. Blocks: not on the loop."""
        self._queue.put(None)
        self._thread.join(timeout_s)
        if not self._thread.is_alive():
            return 0
        self._abandoned = True
        return max(0, self._queue.qsize() - 1) + 1

    def _run(self) -> None:
        while (item := self._queue.get()) is not None and not self._abandoned:
            outlet, payload, attachment = item
            try:
                outlet.put(payload, attachment)
            except zenoh.ZError as error:
                self._call(partial(self._on_failure, f"{outlet.key}: {error}"))
            if self._room_wanted and 2 * self._queue.qsize() <= self._capacity:
                self._room_wanted = False
                self._call(self._room.set)

    def _call(self, function: Callable[[], object]) -> None:
        try:
            self._loop.call_soon_threadsafe(function)
        except RuntimeError:  # the loop has ended; nobody waits any more
            self._abandoned = True


class Outlets:
    """Every key of one service, declared when it is first used."""

    def __init__(
        self,
        session: zenoh.Session,
        name: str,
        make: Callable[[ZenohPublisher, Topic[Message], str], Outlet],
        on_failure: Callable[[str], None],
    ) -> None:
        """Declare nothing yet. `on_failure` hears, on the running loop, what could not be sent and why."""
        self._session = session
        self._name = name
        self._make = make
        self._sender = Sender(name, on_failure)
        self._declaring = asyncio.Lock()
        # A thread of its own: those of `in_thread` may all be busy with the service's work.
        self._declarer = ThreadPoolExecutor(1, thread_name_prefix=f"{name}-declare")
        self._by_key: dict[str, Outlet] = {}
        self._closed = False
        self.known = self._by_key.get
        """Outlet of a key that has been declared."""
        self.send = self._sender.send

    async def at(self, topic: Topic[Message], key: str) -> Outlet:
        """Outlet of a key. Raises NodeClosedError."""
        if self._closed:
            msg = f"nothing more goes out on {key}: the node of {self._name} is closed"
            raise NodeClosedError(msg)
        async with self._declaring:
            outlet = self._by_key.get(key)
            if outlet is None:
                loop = asyncio.get_running_loop()
                publisher = await loop.run_in_executor(self._declarer, declare, self._session, topic, key)
                outlet = self._by_key[key] = self._make(publisher, topic, key)
        return outlet

    def refuse_more(self) -> None:
        """Take no more publications. On the loop, before `finish`."""
        self._closed = True
        self._by_key.clear()
        self._sender.refuse_more()
        self._declarer.shutdown(wait=False, cancel_futures=True)

    def finish(self, timeout_s: float) -> int:
        """See `Sender.finish`."""
        return self._sender.finish(timeout_s)
