"""A service alone under virtual time, and whoever is outside it: hears what it says, and speaks to it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Generic, TypeVar

from msgspec import Struct

from schemas.message import Message
from schemas.topic import Place, Topic
from services.runtime.clock import ManualClock
from services.runtime.guest import Guest
from services.runtime.manual_loop import ManualLoop
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Arrival, Service

C = TypeVar("C", bound=Struct)
AT_ONCE = 4
"""Topics of one subscription; what comes on the same one keeps its order."""
END_S = 5.0


class ServiceStage(Generic[C]):
    """Runs as soon as it is made; `heard` is everything the service has published of what `outside` reads."""

    def __init__(
        self, loop: ManualLoop, service: Service[C], config: C, *, outside: Guest, place: Place, start_ns: int
    ) -> None:
        self.loop, self.heard = loop, list[Message]()
        self.clock, self.bus = ManualClock(loop, start_ns), MemoryBus()
        self.outside = MemoryNode(self.bus, outside, place, self.clock, capacity=100_000)
        self.node = MemoryNode(self.bus, service, place, self.clock)
        self.task = loop.create_task(self._run(config, outside.reads))
        loop.settle()

    async def _run(self, config: C, topics: tuple[Topic[Message], ...]) -> None:
        groups = [topics[first : first + AT_ONCE] for first in range(0, len(topics), AT_ONCE)]
        subscriptions = [self.outside.arrivals(*group) for group in groups]
        async with asyncio.TaskGroup() as group:
            for arrivals in subscriptions:
                group.create_task(self._listen(arrivals))
            await self.node.run(config)
            self.outside.stop()

    async def _listen(self, arrivals: AsyncIterator[Arrival[Message]]) -> None:
        async for arrival in arrivals:
            self.hear(arrival)

    def hear(self, arrival: Arrival[Message]) -> None:
        """Take in what the service says."""
        self.heard.append(arrival.message)

    def say(self, speaker: MemoryNode, topic: Topic[Message], message: Message, **fields: str) -> None:
        """Let somebody publish, and everybody take it in."""
        self.loop.create_task(speaker.publish(topic, message, **fields))
        self.loop.settle()

    def end(self) -> None:
        """Ask the service to finish; it has to."""
        self.node.stop()
        self.loop.advance(END_S)
        assert self.task.done()
        self.task.result()
