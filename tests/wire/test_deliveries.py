"""What each delivery promises, over a real router."""

from __future__ import annotations

import asyncio
import threading

import pytest
import zenoh

from schemas import topics
from schemas.topic import Place
from services.runtime.attachment import decode_attachment
from services.runtime.node import UndeclaredTopicError
from services.runtime.router import Router
from services.runtime.zenoh_publishers import EVENT_CACHE
from tests.wire.stage import KEPT, STATE, STREAM, TRAIN, Stage, event, fix, next_sample, stream_until_heard, take, truth

pytestmark = pytest.mark.usefixtures("router")


async def test_a_late_reader_of_a_stream_hears_only_what_comes_after(stage: Stage) -> None:
    writer = await stage.node("writer", writes=(STREAM,))
    for number in range(5):
        await writer.publish(STREAM, truth(number), device="front")
    reader = await stage.node("reader", reads=(STREAM,))
    first = await stream_until_heard(writer, reader.arrivals(STREAM), start=5)
    assert first.message.t_ns >= 5
    assert (first.source, first.boot_id) == (writer.source, writer.boot_id)
    assert first.sequence == first.message.t_ns
    assert (first.place, first.fields) == (TRAIN, {"device": "front"})


async def test_a_late_reader_of_a_state_gets_the_last_value_of_every_key(stage: Stage) -> None:
    writer = await stage.node("writer", writes=(STATE,))
    for number in range(5):
        for device in ("front", "rear"):
            await writer.publish(STATE, fix(number), device=device)
    reader = await stage.node("reader", reads=(STATE,))
    arrivals = await take(reader.arrivals(STATE), 2)
    assert sorted((a.fields["device"], a.message.t_ns) for a in arrivals) == [("front", 4), ("rear", 4)]
    assert reader.health.counts == {}


async def test_a_late_reader_of_events_gets_what_is_kept_in_order(stage: Stage) -> None:
    writer = await stage.node("writer", writes=(KEPT,))
    for number in range(EVENT_CACHE + 10):
        await writer.publish(KEPT, event(number), service="writer")
    await stage.node("another", writes=(STREAM,))
    reader = await stage.node("reader", reads=(KEPT,))
    arrivals = reader.arrivals(KEPT)
    first = await take(arrivals, 1)
    # The sender's queue may still have been emptying while the reader asked: then the kept ones begin earlier.
    rest = await take(arrivals, EVENT_CACHE + 9 - first[0].sequence)
    assert [a.sequence for a in first + rest] == list(range(first[0].sequence, EVENT_CACHE + 10))


async def test_every_event_arrives_once_and_in_order_however_fast(stage: Stage) -> None:
    reader = await stage.node("reader", reads=(KEPT,))
    arrivals = reader.arrivals(KEPT)
    writer = await stage.node("writer", writes=(KEPT,))

    async def publish() -> None:
        for number in range(20_000):
            await writer.publish(KEPT, event(number), service="writer")

    publishing = asyncio.create_task(publish())
    assert [a.message.t_ns for a in await take(arrivals, 20_000)] == list(range(20_000))
    await publishing
    assert reader.health.dropped == 0
    assert await writer.close() == 0


async def test_closing_sends_what_is_queued(stage: Stage) -> None:
    reader = await stage.node("reader", reads=(KEPT,))
    arrivals = reader.arrivals(KEPT)
    writer = await stage.node("writer", writes=(KEPT,))
    for number in range(500):
        await writer.publish(KEPT, event(number), service="writer")
    assert await writer.close() == 0
    assert [a.sequence for a in await take(arrivals, 500)] == list(range(500))


async def test_a_reader_of_all_places_tells_trains_apart(stage: Stage) -> None:
    writers = {
        train: await stage.node("writer", writes=(STATE,), place=Place("demo", "train", train))
        for train in ("T1", "T2")
    }
    cloud = await stage.node("reader", reads=(STATE,), place=Place("demo", "cloud", "main"))
    onboard = await stage.node("reader", reads=(STATE,))
    everywhere = cloud.arrivals(STATE, anywhere=True)
    here = onboard.arrivals(STATE)
    for number, writer in enumerate(writers.values()):
        await writer.publish(STATE, fix(number), device="front")
    heard = await take(everywhere, 2)
    assert sorted((a.place.name, a.source, a.message.t_ns) for a in heard) == [
        ("T1", "demo/train/T1/writer", 0),
        ("T2", "demo/train/T2/writer", 1),
    ]
    await writers["T1"].publish(STATE, fix(2), device="front")
    assert [(a.place.name, a.message.t_ns) for a in await take(here, 2)] == [("T1", 0), ("T1", 2)]


async def test_two_readers_in_one_service_each_hear_everything(stage: Stage) -> None:
    writer = await stage.node("writer", writes=(KEPT,))
    reader = await stage.node("reader", reads=(KEPT,))
    arrivals, messages = reader.arrivals(KEPT), reader.messages(KEPT)
    for number in range(10):
        await writer.publish(KEPT, event(number), service="writer")
    assert [a.message.t_ns for a in await take(arrivals, 10)] == list(range(10))
    assert [m.t_ns for m in await take(messages, 10)] == list(range(10))


async def test_one_subscription_brings_every_topic_undecoded(stage: Stage) -> None:
    writer = await stage.node("writer", writes=(STREAM, STATE, KEPT))
    await writer.publish(STATE, fix(0), device="front")
    await writer.publish(KEPT, event(0), service="writer")
    recorder = await stage.node("recorder")
    threads = threading.active_count()
    samples = recorder.samples(topics.EVERYTHING)
    assert threading.active_count() == threads + 1
    keys = {sample.key: decode_attachment(sample.attachment) for sample in await take(samples, 2)}
    assert set(keys) == {STATE.at(TRAIN, device="front"), KEPT.at(TRAIN, service="writer")}
    assert {mark.source for mark in keys.values() if mark is not None} == {writer.source}


async def test_publications_say_what_they_are(stage: Stage) -> None:
    foreigner = stage.foreigner()
    subscriber = foreigner.declare_subscriber(topics.EVERYTHING)
    writer = await stage.node("writer", writes=(KEPT,))
    await writer.publish(KEPT, event(7), service="writer")
    sample = await next_sample(subscriber)
    assert str(sample.encoding) == "application/msgpack;health.ServiceEvent"
    assert sample.congestion_control == zenoh.CongestionControl.BLOCK


async def test_undeclared_topics_are_refused(stage: Stage) -> None:
    node = await stage.node("quiet", reads=(STREAM,), writes=(STATE,))
    with pytest.raises(UndeclaredTopicError, match="does not declare that it writes"):
        await node.publish(STREAM, truth(0), device="front")
    with pytest.raises(UndeclaredTopicError, match="does not declare that it reads"):
        node.arrivals(STATE)
    with pytest.raises(TypeError, match=r"carries gnss\.Fix, not TrainTruth"):
        await node.publish(STATE, truth(0), device="front")


async def test_a_stopped_reader_ends(stage: Stage) -> None:
    reader = await stage.node("reader", reads=(STREAM,))
    arrivals = reader.arrivals(STREAM)
    reader.stop()
    with pytest.raises(StopAsyncIteration):
        await take(arrivals, 1)
    assert not await reader.sleep(10.0)


def test_the_router_closes_twice(router: Router) -> None:
    router.close()
    router.close()
