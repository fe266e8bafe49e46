"""A foreign subscriber that takes nothing must not stop our loop."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator

import pytest
import zenoh

from schemas import topics
from services.runtime.zenoh_node import ZenohNode
from services.runtime.zenoh_publishers import QUEUE_CAPACITY, NodeClosedError
from tests.wire.stage import KEPT, STREAM, Stage, event, truth, until, within

pytestmark = pytest.mark.usefixtures("router")
BULK = "x" * 10_000
"""Fills the queues between here and there after some hundred messages."""


@pytest.fixture
def gate() -> Iterator[threading.Event]:
    """Shut until set; opened at the end whatever happens, so that no thread stays behind."""
    gate = threading.Event()
    yield gate
    gate.set()


async def blocked(stage: Stage, gate: threading.Event) -> None:
    """Let a foreigner subscribe to everything and take nothing until the gate opens."""
    reached = asyncio.Event()
    loop = asyncio.get_running_loop()

    def stand(_: zenoh.Sample) -> None:
        if not gate.is_set():
            loop.call_soon_threadsafe(reached.set)
            gate.wait()

    stage.foreigner().declare_subscriber(topics.EVERYTHING, stand)
    pilot = await stage.node("pilot", writes=(STREAM,))
    while not reached.is_set():
        await pilot.publish(STREAM, truth(0), device="pilot")
        await asyncio.sleep(0.01)


async def ticks(count: int) -> None:
    """Prove that timers of the loop still run."""
    for _ in range(count):
        await asyncio.sleep(0.001)


async def test_a_stream_is_dropped_and_never_waits(stage: Stage, gate: threading.Event) -> None:
    await blocked(stage, gate)
    writer = await stage.node("writer", writes=(STREAM,))
    for number in range(3000):
        await within(writer.publish(STREAM, truth(number, BULK), device="front"))
    await within(ticks(10))
    assert writer.health.published == 3000


async def test_events_wait_in_their_own_queue(stage: Stage, gate: threading.Event) -> None:
    await blocked(stage, gate)
    writer = await stage.node("writer", writes=(KEPT,))
    sent = 0

    async def publish() -> None:
        nonlocal sent
        for number in range(4000):
            await writer.publish(KEPT, event(number, BULK), service="writer")
            sent += 1

    publishing = asyncio.create_task(publish())
    await until(lambda: sent > QUEUE_CAPACITY)
    before = -1
    while sent != before:  # until the queue is full and `publish` waits
        before = sent
        await within(ticks(100))
    assert not publishing.done()
    gate.set()
    await within(publishing)
    assert await unsent(writer) == 0


async def unsent(node: ZenohNode) -> int:
    """Close a node; publications that it gave up."""
    return await within(node.close())


async def test_closing_on_a_stuck_link_gives_up_and_counts(stage: Stage, gate: threading.Event) -> None:
    await blocked(stage, gate)
    writer = await stage.node("writer", writes=(KEPT,))
    publishing = asyncio.create_task(flood(writer))
    await until(lambda: writer.health.published > QUEUE_CAPACITY + 10)
    await within(ticks(100))
    loop = asyncio.get_running_loop()
    started_s = loop.time()
    given_up = await unsent(writer)
    # Less than the 1.8 s that a process has for its end.
    assert loop.time() - started_s < 1.8
    assert given_up > 0
    assert writer.health.counts["unsent"] == given_up
    with pytest.raises(NodeClosedError):  # whoever waited for room is told
        await within(publishing)
    gate.set()


async def flood(node: ZenohNode) -> None:
    number = 0
    while True:
        await node.publish(KEPT, event(number, BULK), service="writer")
        number += 1
