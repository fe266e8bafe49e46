"""The bounded queue between the transport and a service's loop.

The transport's thread appends and arms at most one wake-up; the loop drains in batches. When
the queue is full the oldest samples are pushed out and counted.
"""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence

from schemas.message import Message
from schemas.topic import TopicTable
from services.runtime.clock import Clock
from services.runtime.health import HealthBoard
from services.runtime.node import Arrival, Sample
from services.runtime.opener import Opener, arrival_of

DEFAULT_CAPACITY = 4096
BATCH = 256
"""Samples handed on before other tasks of the loop get their turn."""


class Inbox:
    """Samples of one reader, waiting for the loop."""

    def __init__(self, clock: Clock, health: HealthBoard, capacity: int = DEFAULT_CAPACITY) -> None:
        """Make an empty inbox for the running event loop."""
        self._loop = asyncio.get_running_loop()
        self._clock = clock
        self._health = health
        self._queue: deque[Sample] = deque()
        self._capacity = capacity
        self._appending = threading.Lock()
        self._pushed_out = 0
        self._armed = False
        self._closed = False
        self._wake: asyncio.Future[None] | None = None
        self._now_s = clock.monotonic_s()

    def put(self, samples: Sequence[Sample]) -> None:
        """Append from any thread. Pushes the oldest out when full; ignored once closed."""
        if self._closed:
            return
        if self._append(samples):
            self._call(self._count_pushed_out)
        if not self._armed:
            self._armed = True
            self._call(self._awake)

    def put_inline(self, sample: Sample) -> None:
        """Append from the loop's own thread."""
        if self._closed:
            return
        if self._append((sample,)):
            self._count_pushed_out()
        self._awake()

    def refuse(self, reason: str) -> None:
        """Count, from any thread, what is not even worth queueing."""
        self._call(lambda: self._refuse(reason))

    def count_lost(self, what: str, amount: int) -> None:
        """Count, from any thread, publications that no sender keeps any more."""

        def count() -> None:
            self._health.count("lost", amount)
            self._health.trouble("lost", f"{amount} lost for good on {what}", self._clock.monotonic_s())

        self._call(count)

    @property
    def crowded(self) -> bool:
        """More than half full: a transport that can wait should let the reader have its turn."""
        return 2 * len(self._queue) > self._capacity

    @property
    def closed(self) -> bool:
        """Nothing is taken in any more."""
        return self._closed

    def close(self) -> None:
        """Let the reader finish what is queued, and then end. From the loop's thread."""
        self._closed = True
        self._awake()

    def _append(self, samples: Sequence[Sample]) -> bool:
        """Append; True when samples were pushed out and nobody has been told yet."""
        queue = self._queue
        with self._appending:  # several transport threads may fill one inbox
            told = self._pushed_out > 0
            queue.extend(samples)
            while len(queue) > self._capacity:
                queue.popleft()
                self._pushed_out += 1
            return self._pushed_out > 0 and not told

    def _count_pushed_out(self) -> None:
        with self._appending:
            count, self._pushed_out = self._pushed_out, 0
        self._health.dropped += count
        reason = f"a full inbox ({self._capacity}) pushed out {count} arrivals"
        self._health.trouble("dropped", reason, self._clock.monotonic_s())

    def _call(self, function: Callable[[], None]) -> None:
        try:
            self._loop.call_soon_threadsafe(function)
        except RuntimeError:  # the loop has ended; nobody will read this any more
            self._closed = True

    def _awake(self) -> None:
        self._armed = False
        if self._wake is not None and not self._wake.done():
            self._wake.set_result(None)

    async def _wait(self) -> bool:
        """Wait for samples; False when there will be none any more."""
        if not self._queue:
            if self._closed:
                return False
            self._wake = self._loop.create_future()
            await self._wake
            self._wake = None
        self._now_s = self._clock.monotonic_s()
        return True

    async def samples(self) -> AsyncIterator[Sample]:
        """Queued samples, oldest first, until closed and empty."""
        queue = self._queue
        try:
            while await self._wait():
                for _ in range(min(len(queue), BATCH)):
                    yield queue.popleft()
                if queue:
                    await asyncio.sleep(0)
        finally:
            self._closed = True

    async def arrivals(self, table: TopicTable) -> AsyncIterator[Arrival[Message]]:
        """Queued samples decoded; what is refused or repeated is counted and left out."""
        queue = self._queue
        opener = Opener(table, self._health)
        try:
            while await self._wait():
                for _ in range(min(len(queue), BATCH)):
                    sample = queue.popleft()
                    opened = opener.open(sample, self._now_s)
                    if opened is not None:
                        message, sent, address = opened
                        yield arrival_of(message, sample, sent, address)
                if queue:
                    await asyncio.sleep(0)
        finally:
            self._closed = True
            opener.close()

    async def messages(self, table: TopicTable) -> AsyncIterator[Message]:
        """The messages of `arrivals` alone."""
        queue = self._queue
        opener = Opener(table, self._health)
        try:
            while await self._wait():
                for _ in range(min(len(queue), BATCH)):
                    opened = opener.open(queue.popleft(), self._now_s)
                    if opened is not None:
                        yield opened[0]
                if queue:
                    await asyncio.sleep(0)
        finally:
            self._closed = True
            opener.close()

    def _refuse(self, reason: str) -> None:
        self._health.refuse(reason, self._clock.monotonic_s())
