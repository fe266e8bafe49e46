"""Questions and mirrored publications on the bus inside one process."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from schemas import queries, topics
from schemas.bridge import BridgeAcknowledgement, BridgeBatch
from schemas.codec import encode
from schemas.health import ServiceEvent
from schemas.topic import Place, TopicError
from services.runtime.attachment import Attachment, encode_attachment
from services.runtime.clock import ManualClock
from services.runtime.guest import Guest, guest
from services.runtime.host_config import BusConfig
from services.runtime.manual_loop import run_manual
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Sample, UndeclaredTopicError
from services.runtime.question import NoAnswerError, Question, RefusedError

TRAIN, CLOUD = Place("demo", "train", "T1"), Place("demo", "cloud", "C1")
FAR = BusConfig(connect=("tcp/10.0.0.1:7447",))
ASKER = guest("asker", "asks", asks=(queries.INGEST,))
STORE = guest("store", "answers", answers=(queries.INGEST,))
MIRROR = guest("mirror", "says again", reads=(topics.SERVICE_EVENT,), mirrors=True)


def batch(first: int) -> BridgeBatch:
    return BridgeBatch(t_ns=1, bridge="b", lane="events", spool_id="s", first=first, count=2, compressed=b"")


def acknowledgement(through: int) -> BridgeAcknowledgement:
    return BridgeAcknowledgement(t_ns=2, bridge="b", lane="events", spool_id="s", through=through)


def node(bus: MemoryBus, service: Guest, place: Place) -> MemoryNode:
    return MemoryNode(bus, service, place, ManualClock(asyncio.get_running_loop(), 1_000))


async def answer_all(store: MemoryNode) -> list[str]:
    sources = []
    async for question in store.questions(queries.INGEST, shard="all"):
        sources.append(question.source)
        if question.request.first == 13:
            await question.refuse("the disk is full")
        else:
            await question.answer(acknowledgement(question.request.first + 1))
            await question.refuse("a second word is dropped")
    return sources


def test_a_question_is_answered_or_refused_with_the_reason() -> None:
    async def main() -> tuple[int, str, list[str]]:
        bus = MemoryBus()
        store, asker = node(bus, STORE, CLOUD), node(bus, ASKER, TRAIN)
        answering = asyncio.create_task(answer_all(store))
        await asyncio.sleep(0)
        reply = await asker.ask(queries.INGEST, CLOUD, batch(5), timeout_s=1.0, shard="all")
        with pytest.raises(RefusedError) as refused:
            await asker.ask(queries.INGEST, CLOUD, batch(13), timeout_s=1.0, shard="all")
        store.stop()
        return reply.through, str(refused.value), await answering

    assert run_manual(main()) == (6, "the disk is full", ["demo/train/T1/asker"] * 2)


def test_nobody_there_and_a_cut_link_are_no_answer() -> None:
    async def main() -> float:
        bus, far = MemoryBus(), MemoryBus()
        bus.others[FAR.connect[0]] = far
        store, asker = node(far, STORE, CLOUD), node(bus, ASKER, TRAIN)
        with pytest.raises(NoAnswerError, match="nobody answered"):
            await asker.ask(queries.INGEST, CLOUD, batch(5), timeout_s=1.0, shard="all")
        answering = asyncio.create_task(answer_all(store))
        await asyncio.sleep(0)
        async with asker.elsewhere(FAR) as there:
            assert (await there.ask(queries.INGEST, CLOUD, batch(5), timeout_s=1.0, shard="all")).through == 6
            far.cut = True
            began_s = asyncio.get_running_loop().time()
            with pytest.raises(NoAnswerError):
                await there.ask(queries.INGEST, CLOUD, batch(5), timeout_s=4.0, shard="all")
            waited_s = asyncio.get_running_loop().time() - began_s
        store.stop()
        await answering
        return waited_s

    assert run_manual(main()) == 4.0


def test_what_is_not_declared_is_refused() -> None:
    async def main() -> None:
        bus = MemoryBus()
        other = node(bus, MIRROR, CLOUD)
        with pytest.raises(UndeclaredTopicError, match="asks"):
            await other.ask(queries.INGEST, CLOUD, batch(1), timeout_s=1.0, shard="all")
        with pytest.raises(UndeclaredTopicError, match="answers"):
            other.questions(queries.INGEST, shard="all")
        with pytest.raises(UndeclaredTopicError, match="mirrors"):
            await node(bus, STORE, CLOUD).publish_mirrored(Sample("k", b"", b"", 0))

    run_manual(main())


def test_an_answer_of_another_type_is_refused() -> None:
    async def main() -> None:
        bus = MemoryBus()
        store, asker = node(bus, STORE, CLOUD), node(bus, ASKER, TRAIN)
        questions = store.questions(queries.INGEST, shard="all")
        asking = asyncio.create_task(asker.ask(queries.INGEST, CLOUD, batch(1), timeout_s=1.0, shard="all"))
        question: Question[Any, Any] = await anext(questions)
        with pytest.raises(TypeError, match="BridgeAcknowledgement"):
            await question.answer(batch(1))
        asking.cancel()

    run_manual(main())


def test_what_is_mirrored_keeps_its_sender_and_its_number() -> None:
    async def main() -> tuple[str, int, Place, int]:
        bus = MemoryBus()
        mirror = node(bus, MIRROR, CLOUD)
        near, far = (
            mirror.arrivals(topics.SERVICE_EVENT, anywhere=True),
            mirror.arrivals(topics.SERVICE_EVENT, mirrored=True),
        )
        message = ServiceEvent(t_ns=7, service="gnss", boot_id="b", kind="level", text="")
        mark = encode_attachment(Attachment("demo/train/T1/gnss", "b", 41, 9))
        key = topics.SERVICE_EVENT.at(TRAIN, service="gnss")
        await mirror.publish_mirrored(Sample(key, encode(message), mark, 10))
        with pytest.raises(TopicError):
            await mirror.publish_mirrored(Sample("kirotei/v1/demo/train/T1/never/heard", b"", mark, 10))
        mirror.stop()
        heard = [arrival async for arrival in far]
        assert [arrival async for arrival in near] == []
        assert len(heard) == 1
        return heard[0].source, heard[0].sequence, heard[0].place, heard[0].message.t_ns

    assert run_manual(main()) == ("demo/train/T1/gnss", 41, TRAIN, 7)
