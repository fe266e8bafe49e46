"""Questions over a real router, and over a link to another one."""

from __future__ import annotations

import asyncio

import pytest
import zenoh

from schemas import queries
from schemas.bridge import BridgeAcknowledgement, BridgeBatch
from schemas.codec import encode
from schemas.topic import Place
from services.runtime.attachment import Attachment, encode_attachment
from services.runtime.clock import LiveClock
from services.runtime.guest import Guest, guest
from services.runtime.host_config import BusConfig
from services.runtime.node import Sample
from services.runtime.question import NoAnswerError, RefusedError
from services.runtime.zenoh_node import ZenohNode
from tests.wire.stage import KEPT, LIMIT_S, STEP_S, TRAIN, event, take

pytestmark = pytest.mark.usefixtures("router")
CLOUD = Place("demo", "cloud", "C1")
ASKER = guest("asker", "asks", asks=(queries.INGEST,))
STORE = guest("store", "answers", reads=(KEPT,), answers=(queries.INGEST,), mirrors=True)
COMPRESSED = bytes(range(256)) * 1024
"""A quarter of a megabyte."""


def batch(first: int) -> BridgeBatch:
    return BridgeBatch(t_ns=1, bridge="b", lane="bulk", spool_id="s", first=first, count=2, compressed=COMPRESSED)


async def answer_all(store: ZenohNode) -> None:
    async for question in store.questions(queries.INGEST, shard="all"):
        assert question.request.compressed == COMPRESSED
        assert question.source == "demo/train/T1/asker"
        if question.request.first == 13:
            await question.refuse("the disk is full")
        elif question.request.first != 14:
            reply = BridgeAcknowledgement(
                t_ns=2, bridge="b", lane="bulk", spool_id="s", through=question.request.first + 1
            )
            await question.answer(reply)


async def open_node(service: Guest, place: Place, endpoint: str) -> ZenohNode:
    bus = BusConfig(connect=(endpoint,))
    return await ZenohNode.open(service, place, service.name, LiveClock(), bus, announced=False)


async def test_a_question_is_answered_refused_or_ends_in_time(endpoint: str) -> None:
    store = await open_node(STORE, CLOUD, endpoint)
    asker = await open_node(ASKER, TRAIN, endpoint)
    try:
        with pytest.raises(NoAnswerError):
            await asker.ask(queries.INGEST, CLOUD, batch(1), timeout_s=1.0, shard="all")
        answering = asyncio.create_task(answer_all(store))
        reply = None
        async with asyncio.timeout(LIMIT_S):
            while reply is None:
                try:
                    reply = await asker.ask(queries.INGEST, CLOUD, batch(1), timeout_s=1.0, shard="all")
                except NoAnswerError:
                    await asyncio.sleep(STEP_S)  # the router has not heard of the store yet
        assert reply.through == 2
        with pytest.raises(RefusedError, match="the disk is full"):
            await asker.ask(queries.INGEST, CLOUD, batch(13), timeout_s=5.0, shard="all")
        with pytest.raises(NoAnswerError):
            await asker.ask(queries.INGEST, CLOUD, batch(14), timeout_s=0.5, shard="all")
        found = await asyncio.gather(
            *(asker.ask(queries.INGEST, CLOUD, batch(n), timeout_s=10.0, shard="all") for n in range(20, 40))
        )
        assert [one.through for one in found] == list(range(21, 41))
        store.stop()
        await answering
    finally:
        await asker.close()
        await store.close()


async def test_a_question_that_cannot_be_read_is_refused(endpoint: str) -> None:
    store = await open_node(STORE, CLOUD, endpoint)
    reading = asyncio.create_task(answer_all(store))
    config = zenoh.Config.from_json5(f'{{mode: "client", connect: {{endpoints: ["{endpoint}"]}}}}')

    def ask() -> list[bytes]:
        with zenoh.open(config) as session:
            key = queries.INGEST.at(CLOUD, shard="all")
            replies = session.get(key, payload=b"\xc1 no message", timeout=5.0)
            return [reply.err.payload.to_bytes() for reply in replies if reply.err is not None]

    try:
        refusals = await asyncio.to_thread(ask)
        assert len(refusals) == 1
        assert refusals[0].startswith(b"the question cannot be read")
        assert store.health.refused == 1
    finally:
        reading.cancel()
        await store.close()


async def test_a_service_asks_and_mirrors_elsewhere(endpoint: str) -> None:
    asker = await open_node(ASKER, TRAIN, endpoint)
    try:
        async with asker.elsewhere(BusConfig(connect=(endpoint,))) as there:
            with pytest.raises(NoAnswerError):
                await there.ask(queries.INGEST, CLOUD, batch(1), timeout_s=0.3, shard="all")
    finally:
        await asker.close()


async def test_what_is_mirrored_arrives_as_it_was_said(endpoint: str) -> None:
    store = await open_node(STORE, CLOUD, endpoint)
    try:
        arrivals = store.arrivals(KEPT, mirrored=True)
        key = KEPT.at(TRAIN, service="writer")
        for number in range(5):
            mark = encode_attachment(Attachment("demo/train/T1/writer", "b", number, 9))
            await store.publish_mirrored(Sample(key, encode(event(number)), mark, 10))
        heard = await take(arrivals, 5)
        assert [(one.sequence, one.message.t_ns) for one in heard] == [(n, n) for n in range(5)]
        assert {(one.place, one.source, one.boot_id) for one in heard} == {(TRAIN, "demo/train/T1/writer", "b")}
    finally:
        await store.close()
