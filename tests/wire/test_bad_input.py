"""What foreigners, newer senders and broken ones put on our keys is counted, and the session lives on."""

from __future__ import annotations

import asyncio
import threading
import time

import msgspec
import pytest
import zenoh

from schemas import topics
from schemas.codec import encode
from schemas.topic import ROOT
from services.runtime.attachment import Attachment, encode_attachment
from services.runtime.clock import LiveClock
from services.runtime.inbox import DEFAULT_CAPACITY
from tests.wire.stage import KEPT, STATE, STREAM, TRAIN, Stage, event, fix, take, truth, until

pytestmark = pytest.mark.usefixtures("router")
KEY = STREAM.at(TRAIN, device="front")


async def test_garbage_newer_and_huge_messages(stage: Stage) -> None:
    reader = await stage.node("reader", reads=(STREAM,))
    arrivals = reader.arrivals(STREAM)
    foreigner = stage.foreigner()
    newer = msgspec.msgpack.encode(msgspec.structs.asdict(truth(5)) | {"from_the_future": [1, 2]})
    for payload in (b"\xc1garbage", b"", b"\x00" * 10_000_000, newer):
        foreigner.put(KEY, payload, congestion_control=zenoh.CongestionControl.BLOCK)
    foreigner.delete(KEY)
    foreigner.put(KEY, encode(truth(6)))
    # A plain `zenoh put` has no mark: nothing is known of its sender, but it is a message.
    heard = await take(arrivals, 2)
    assert [(a.message.t_ns, a.source, a.sequence) for a in heard] == [(5, "", -1), (6, "", -1)]
    await until(lambda: reader.health.refused == 4)
    assert reader.health.received == 2
    assert reader.health.report(0, 0.0).inputs == ()


async def test_ten_megabytes_are_named(stage: Stage) -> None:
    reader = await stage.node("recorder")
    samples = reader.samples(topics.EVERYTHING)
    foreigner = stage.foreigner()
    foreigner.put(KEY, b"\x00" * 10_000_000, congestion_control=zenoh.CongestionControl.BLOCK)
    foreigner.put(KEY, b"small")
    assert [sample.payload for sample in await take(samples, 1)] == [b"small"]
    await until(lambda: reader.health.refused == 1)
    assert "10000000 bytes" in reader.health.level(reader.clock.monotonic_s())[1][0]


@pytest.mark.parametrize("attachment", [b"", b"\xc1", b"text", b"\x94\xa1a\xa1b\xff\x00", b"\x94\xa1\xff\xa1b\x00\x00"])
async def test_an_attachment_that_is_not_ours_counts_as_none(stage: Stage, attachment: bytes) -> None:
    reader = await stage.node("reader", reads=(STREAM,))
    arrivals = reader.arrivals(STREAM)
    stage.foreigner().put(KEY, encode(truth(1)), attachment=attachment)
    assert [(a.message.t_ns, a.source) for a in await take(arrivals, 1)] == [(1, "")]


async def test_repetitions_and_gaps_of_a_foreign_sender(stage: Stage) -> None:
    reader = await stage.node("reader", reads=(STREAM,))
    arrivals = reader.arrivals(STREAM)
    foreigner = stage.foreigner()
    for number in (3, 4, 4, 2, 8):
        mark = encode_attachment(Attachment("elsewhere", "boot", number, time.time_ns()))
        foreigner.put(KEY, encode(truth(number)), attachment=mark)
    assert [a.sequence for a in await take(arrivals, 3)] == [3, 4, 8]
    report = reader.health.report(0, 0.0).inputs[0]
    assert (report.received, report.duplicated, report.missing) == (3, 2, 3)


async def test_keys_without_a_topic_reach_who_asks_for_everything(stage: Stage) -> None:
    recorder = await stage.node("recorder")
    samples = recorder.samples(topics.EVERYTHING)
    stage.foreigner().put(f"{ROOT}/demo/train/T1/what/is/this", b"?")
    assert [sample.key for sample in await take(samples, 1)] == [f"{ROOT}/demo/train/T1/what/is/this"]


async def test_a_reader_that_raises_harms_nobody(stage: Stage) -> None:
    writer = await stage.node("writer", writes=(KEPT,))
    reader = await stage.node("reader", reads=(KEPT,))
    steady = reader.arrivals(KEPT)

    async def stumble() -> None:
        async for arrival in reader.arrivals(KEPT):
            msg = f"cannot stand {arrival.sequence}"
            raise ArithmeticError(msg)

    await writer.publish(KEPT, event(0), service="writer")
    with pytest.raises(ArithmeticError, match="cannot stand 0"):
        await stumble()
    for number in range(1, 20):
        await writer.publish(KEPT, event(number), service="writer")
    assert [a.sequence for a in await take(steady, 20)] == list(range(20))


async def test_a_reader_that_does_not_read_loses_its_own_oldest_and_stalls_nobody(stage: Stage) -> None:
    writer = await stage.node("writer", writes=(STATE, KEPT))
    node = await stage.node("reader", reads=(STATE, KEPT))
    idle, busy = node.arrivals(STATE), node.arrivals(KEPT)
    count = DEFAULT_CAPACITY + 1000
    marks = range(0, count, 100)
    for number in range(count):
        await writer.publish(STATE, fix(number), device="front")
        if number in marks:
            await writer.publish(KEPT, event(number), service="writer")
    assert [a.message.t_ns for a in await take(busy, len(marks))] == list(marks)
    # The idle reader's inbox holds the newest, gapless up to the very last.
    last = -1
    while last != count - 1:
        last = (await take(idle, 1))[0].message.t_ns
    await until(lambda: node.health.dropped > 0)
    assert "full inbox" in " ".join(node.health.level(node.clock.monotonic_s())[1])


async def test_readers_that_come_and_go_leave_nothing_behind(stage: Stage) -> None:
    writer = await stage.node("writer", writes=(KEPT,))
    node = await stage.node("reader", reads=(KEPT,))
    await writer.publish(KEPT, event(0), service="writer")
    threads = threading.active_count()
    for _ in range(50):
        arrivals = node.arrivals(KEPT)
        await take(arrivals, 1)
        await arrivals.aclose()  # type: ignore[attr-defined]  # an async generator, promised as an iterator only
        await writer.publish(KEPT, event(0), service="writer")
    # A reader's thread ends with the first sample after its reader has gone.
    await until(lambda: threading.active_count() <= threads + 1)
    assert len(node._subscriptions) < 10
    assert len(node.health._readers) < 20


class SteppingClock(LiveClock):
    """A host's clock that an operator sets back by an hour."""

    def __init__(self) -> None:
        self.step_ns = 0

    def now_ns(self) -> int:
        return super().now_ns() + self.step_ns


async def test_a_clock_that_steps_back_disorders_nothing(stage: Stage) -> None:
    clock = SteppingClock()
    writer = await stage.node("writer", writes=(KEPT, STATE), clock=clock)
    reader = await stage.node("reader", reads=(KEPT, STATE))
    events, state = reader.arrivals(KEPT), reader.arrivals(STATE)
    for number in range(10):
        if number == 5:
            clock.step_ns = -3_600_000_000_000
        await writer.publish(KEPT, event(number), service="writer")
        await writer.publish(STATE, fix(number), device="front")
    heard = await take(events, 10)
    assert [a.sequence for a in heard] == list(range(10))
    assert (heard[4].sent_ns - heard[5].sent_ns) // 1_000_000_000 in (3599, 3600)
    seen = -1
    while seen != 9:  # a reader of a state may skip, but the newest comes, older clock or not
        seen = (await take(state, 1))[0].message.t_ns
    # The delay is what the two clocks say, an hour, and not made to look better.
    assert all(entry.delay_s > 3599.0 for entry in reader.health.report(0, 0.0).inputs)
    assert all(entry.missing == 0 for entry in reader.health.report(0, 0.0).inputs)


async def test_a_clock_ahead_shows_as_negative_delay(stage: Stage) -> None:
    clock = SteppingClock()
    clock.step_ns = 60_000_000_000
    writer = await stage.node("writer", writes=(KEPT,), clock=clock)
    reader = await stage.node("reader", reads=(KEPT,))
    await writer.publish(KEPT, event(0), service="writer")
    await take(reader.arrivals(KEPT), 1)
    # One minute ahead, less what the message took, which is far less than half a minute.
    assert -60.0 <= reader.health.report(0, 0.0).inputs[0].delay_s < -30.0


async def test_publishing_at_once_from_many_tasks_numbers_without_gap(stage: Stage) -> None:
    reader = await stage.node("reader", reads=(KEPT,))
    events = reader.arrivals(KEPT)
    writer = await stage.node("writer", writes=(KEPT,))
    async with asyncio.TaskGroup() as group:
        for number in range(2000):
            group.create_task(writer.publish(KEPT, event(number), service="writer"))
    assert [a.sequence for a in await take(events, 2000)] == list(range(2000))
