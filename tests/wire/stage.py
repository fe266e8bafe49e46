"""What tests on the wire have in common: services, messages, waiting with a limit."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any, TypeVar

import zenoh

from schemas import topics
from schemas.gnss import Fix
from schemas.health import ServiceEvent
from schemas.message import Message
from schemas.position import TrainTruth
from schemas.topic import Place, Topic
from services.runtime.clock import Clock, LiveClock
from services.runtime.guest import Guest, guest
from services.runtime.host_config import BusConfig
from services.runtime.node import Arrival
from services.runtime.zenoh_node import ZenohNode
from services.runtime.zenoh_session import close_session

T = TypeVar("T")
TRAIN = Place("demo", "train", "T1")
LIMIT_S = 15.0
"""Longest wait for anything; reached only when a test fails."""
STEP_S = 0.01
STREAM, STATE, KEPT = topics.TRAIN_TRUTH, topics.GNSS_FIX, topics.SERVICE_EVENT


def service(name: str, reads: tuple[Topic[Any], ...] = (), writes: tuple[Topic[Any], ...] = ()) -> Guest:
    return guest(name, "a test's service", reads=reads, writes=writes)


def truth(t_ns: int, surroundings: str = "") -> TrainTruth:
    return TrainTruth(
        t_ns=t_ns,
        lat_deg=35.0,
        lon_deg=135.0,
        h_m=0,
        ve_mps=0,
        vn_mps=0,
        vu_mps=0,
        axis_m=0,
        speed_mps=0,
        surroundings=surroundings,
    )


def event(t_ns: int, text: str = "") -> ServiceEvent:
    return ServiceEvent(t_ns=t_ns, service="writer", boot_id="b", kind="level", text=text)


def fix(t_ns: int) -> Fix:
    return Fix(
        t_ns=t_ns, gps_week=2400, tow_s=0.0, method="original", status="none", satellites_used=0, satellites_flagged=0
    )


class Stage:
    """Nodes and foreign sessions of one test on one router's address."""

    def __init__(self, endpoint: str) -> None:
        self.bus = BusConfig(connect=(endpoint,))
        self._nodes: list[ZenohNode] = []
        self._sessions: list[zenoh.Session] = []

    async def node(
        self,
        name: str,
        *,
        reads: tuple[Topic[Any], ...] = (),
        writes: tuple[Topic[Any], ...] = (),
        place: Place = TRAIN,
        clock: Clock | None = None,
        on_waiting: Callable[[str], None] | None = None,
    ) -> ZenohNode:
        opening = ZenohNode.open(
            service(name, reads, writes), place, name, clock or LiveClock(), self.bus, on_waiting=on_waiting
        )
        node = await within(opening)
        self._nodes.append(node)
        return node

    def foreigner(self) -> zenoh.Session:
        """A session that knows nothing of Kirotei."""
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps(list(self.bus.connect)))
        config.insert_json5("scouting/multicast/enabled", "false")
        session = zenoh.open(config)
        self._sessions.append(session)
        return session

    async def close(self) -> None:
        for node in self._nodes:
            await node.close()
        for session in self._sessions:
            if not session.is_closed():
                await asyncio.to_thread(close_session, session)


async def within(work: Awaitable[T], limit_s: float = LIMIT_S) -> T:
    """Result of `work`, or TimeoutError."""
    async with asyncio.timeout(limit_s):
        return await work


async def until(condition: Callable[[], bool]) -> None:
    """Return once the condition holds; TimeoutError when it never does."""
    async with asyncio.timeout(LIMIT_S):
        while not condition():  # noqa: ASYNC110 - what is waited for happens on a thread that knows no event
            await asyncio.sleep(STEP_S)


async def take(arrivals: AsyncIterator[T], count: int) -> list[T]:
    """The next `count` of them."""
    async with asyncio.timeout(LIMIT_S):
        return [await anext(arrivals) for _ in range(count)]


async def next_sample(subscriber: zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]) -> zenoh.Sample:
    """What a foreign subscriber gets next."""
    async with asyncio.timeout(LIMIT_S):
        while (sample := subscriber.try_recv()) is None:  # noqa: ASYNC110 - Zenoh has no event for it
            await asyncio.sleep(STEP_S)
    return sample


async def stream_until_heard(
    writer: ZenohNode, arrivals: AsyncIterator[Arrival[Message]], start: int = 0
) -> Arrival[Message]:
    """First arrival of a stream that is published until someone hears it (`t_ns` counts from `start`)."""

    async def publish() -> None:
        number = start
        while True:
            await writer.publish(STREAM, truth(number), device="front")
            number += 1
            await asyncio.sleep(STEP_S)

    publishing = asyncio.create_task(publish())
    try:
        return await within(anext(arrivals))
    finally:
        publishing.cancel()
