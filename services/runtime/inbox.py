"""The bounded queue between the transport and a service's loop.

The transport's thread appends and arms at most one wake-up; the loop drains in batches. When
the queue is full the oldest sample is pushed out and counted.
"""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import AsyncIterator

from schemas.codec import DecodeError, decode
from schemas.message import Message
from schemas.topics import TopicTable
from services.runtime.attachment import Attachment, decode_attachment
from services.runtime.clock import Clock
from services.runtime.health import HealthBoard
from services.runtime.node import Arrival, Sample
from services.runtime.sequence import Mark

DEFAULT_CAPACITY = 4096
BATCH = 256
"""Samples handed on before other tasks of the loop get their turn."""
_UNMARKED = Attachment("", "", -1, 0)


async def messages_of(arrivals: AsyncIterator[Arrival[Message]]) -> AsyncIterator[Message]:
    """The messages of arrivals, without their senders."""
    async for arrival in arrivals:
        yield arrival.message


class Inbox:
    """Samples of one subscription, waiting for the loop."""

    def __init__(self, clock: Clock, health: HealthBoard, capacity: int = DEFAULT_CAPACITY) -> None:
        """Make an empty inbox for the running event loop."""
        self._loop = asyncio.get_running_loop()
        self._clock = clock
        self._health = health
        self._queue: deque[Sample] = deque(maxlen=capacity)
        self._capacity = capacity
        self._overflow = threading.Lock()
        self._armed = False
        self._closed = False
        self._wake: asyncio.Future[None] | None = None

    def put(self, sample: Sample) -> None:
        """Append from any thread. Pushes the oldest out when full; ignored once closed."""
        if self._closed:
            return
        if len(self._queue) >= self._capacity:
            with self._overflow:  # several transport threads may overflow one inbox
                self._health.dropped += 1
        self._queue.append(sample)
        if not self._armed:
            self._armed = True
            try:
                self._loop.call_soon_threadsafe(self._awake)
            except RuntimeError:  # the loop has ended; nobody will read this any more
                self._closed = True

    def put_inline(self, sample: Sample) -> None:
        """Append from the loop's own thread."""
        if self._closed:
            return
        if len(self._queue) >= self._capacity:
            with self._overflow:  # several transport threads may overflow one inbox
                self._health.dropped += 1
        self._queue.append(sample)
        self._awake()

    def close(self) -> None:
        """Let the reader finish what is queued, and then end. From the loop's thread."""
        self._closed = True
        self._awake()

    def _awake(self) -> None:
        self._armed = False
        if self._wake is not None and not self._wake.done():
            self._wake.set_result(None)

    async def samples(self) -> AsyncIterator[Sample]:
        """Queued samples, oldest first, until closed and empty."""
        handed = 0
        while True:
            while self._queue:
                yield self._queue.popleft()
                handed += 1
                if handed % BATCH == 0:
                    await asyncio.sleep(0)
            if self._closed:
                return
            self._wake = self._loop.create_future()
            if not self._queue:
                await self._wake
            self._wake = None

    async def arrivals(self, table: TopicTable) -> AsyncIterator[Arrival[Message]]:
        """Queued samples decoded; what is refused or repeated is counted and left out."""
        async for sample in self.samples():
            arrival = self._open(sample, table)
            if arrival is not None:
                yield arrival

    def _open(self, sample: Sample, table: TopicTable) -> Arrival[Message] | None:
        address = table.find(sample.key)
        mark = _UNMARKED if not sample.attachment else (decode_attachment(sample.attachment) or _UNMARKED)
        now_s = self._clock.monotonic_s()
        if mark.source:
            delay_s = (sample.received_ns - mark.sent_ns) / 1e9
            noted = self._health.note_arrival(sample.key, mark.source, mark.boot_id, mark.sequence, delay_s, now_s)
            if noted is Mark.DUPLICATE:
                return None
        if address is None:
            self._refuse(f"no topic has the key {sample.key}", now_s)
            return None
        try:
            message = decode(address.topic.message, sample.payload)
        except DecodeError as error:
            self._refuse(f"{sample.key} from {mark.source or 'an unknown sender'}: {error}", now_s)
            return None
        self._health.received += 1
        return Arrival(
            message,
            sample.key,
            address.place,
            address.fields,
            mark.source,
            mark.boot_id,
            mark.sequence,
            mark.sent_ns,
            sample.received_ns,
        )

    def _refuse(self, reason: str, now_s: float) -> None:
        self._health.refused += 1
        self._health.trouble("refused", f"refused: {reason[:300]}", now_s)
