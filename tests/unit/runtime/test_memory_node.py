"""Services on the bus inside one process, with virtual time."""

from __future__ import annotations

import asyncio

import msgspec
import pytest

from schemas import topics
from schemas.health import ServiceEvent
from schemas.message import Message
from schemas.position import TrainTruth
from schemas.topic import Place, Topic
from services.runtime.clock import ManualClock
from services.runtime.guest import Guest, guest
from services.runtime.manual_loop import DeadlockError, ManualLoop, manual_loop, run_manual
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import UndeclaredTopicError

TRAIN = Place("demo", "train", "T1")


def truth(t_ns: int) -> TrainTruth:
    return TrainTruth(
        t_ns=t_ns, lat_deg=35.0, lon_deg=135.0, h_m=0, ve_mps=0, vn_mps=0, vu_mps=0, axis_m=0, speed_mps=0
    )


def service(name: str, reads: tuple[Topic[Message], ...] = (), writes: tuple[Topic[Message], ...] = ()) -> Guest:
    return guest(name, "a test's service", reads=reads, writes=writes)


def test_messages_arrive_in_order_with_their_sender() -> None:
    async def main() -> list[tuple[int, str, int]]:
        clock = ManualClock(asyncio.get_running_loop(), 1_000)
        bus = MemoryBus()
        writer = MemoryNode(bus, service("writer", writes=(topics.TRAIN_TRUTH,)), TRAIN, clock)
        reader = MemoryNode(bus, service("reader", reads=(topics.TRAIN_TRUTH,)), TRAIN, clock)
        arrivals = reader.arrivals(topics.TRAIN_TRUTH)
        for index in range(3):
            await writer.publish(topics.TRAIN_TRUTH, truth(index), device="front")
        reader.stop()
        return [(a.message.t_ns, a.source, a.sequence) async for a in arrivals]

    assert run_manual(main()) == [(i, "demo/train/T1/writer", i) for i in range(3)]


def test_undeclared_topics_are_refused() -> None:
    async def main() -> None:
        clock = ManualClock(asyncio.get_running_loop())
        node = MemoryNode(MemoryBus(), service("quiet"), TRAIN, clock)
        with pytest.raises(UndeclaredTopicError, match="does not declare that it writes"):
            await node.publish(topics.TRAIN_TRUTH, truth(0), device="front")
        with pytest.raises(UndeclaredTopicError, match="does not declare that it reads"):
            node.arrivals(topics.TRAIN_TRUTH)

    run_manual(main())


def test_a_message_of_another_type_is_refused() -> None:
    async def main() -> None:
        clock = ManualClock(asyncio.get_running_loop())
        node = MemoryNode(MemoryBus(), service("wrong", writes=(topics.GNSS_FIX,)), TRAIN, clock)
        with pytest.raises(TypeError, match=r"carries gnss\.Fix, not TrainTruth"):
            await node.publish(topics.GNSS_FIX, truth(0), device="front")

    run_manual(main())


def test_late_reader_gets_kept_events_but_no_stream() -> None:
    async def main() -> list[str]:
        clock = ManualClock(asyncio.get_running_loop())
        bus = MemoryBus()
        writes = (topics.TRAIN_TRUTH,)
        writer = MemoryNode(bus, service("writer", writes=writes), TRAIN, clock)
        await writer.publish(topics.TRAIN_TRUTH, truth(0), device="front")
        for kind in ("started", "stopping"):
            event = ServiceEvent(t_ns=0, service="writer", boot_id="b", kind=kind, text="")
            await writer.publish(topics.SERVICE_EVENT, event, service="writer")
        reader = MemoryNode(bus, service("reader", reads=(topics.SERVICE_EVENT, topics.TRAIN_TRUTH)), TRAIN, clock)
        arrivals = reader.arrivals(topics.SERVICE_EVENT, topics.TRAIN_TRUTH)
        reader.stop()
        return [a.message.kind if isinstance(a.message, ServiceEvent) else "truth" async for a in arrivals]

    assert run_manual(main()) == ["started", "stopping"]


def test_full_inbox_counts_what_it_pushes_out() -> None:
    async def main() -> tuple[list[int], int, int]:
        clock = ManualClock(asyncio.get_running_loop())
        bus = MemoryBus()
        writer = MemoryNode(bus, service("writer", writes=(topics.TRAIN_TRUTH,)), TRAIN, clock)
        reader = MemoryNode(bus, service("reader", reads=(topics.TRAIN_TRUTH,)), TRAIN, clock, capacity=4)
        arrivals = reader.arrivals(topics.TRAIN_TRUTH)
        for index in range(10):
            await writer.publish(topics.TRAIN_TRUTH, truth(index), device="front")
        reader.stop()
        got = [a.message.t_ns async for a in arrivals]
        return got, reader.health.dropped, reader.health.report(0, 0.0).inputs[0].missing

    # The six that were pushed out come before the first that is seen, so they are drops, not gaps.
    assert run_manual(main()) == ([6, 7, 8, 9], 6, 0)


def test_garbage_newer_and_huge_messages_are_counted() -> None:
    async def main() -> tuple[int, int, tuple[str, ...]]:
        from schemas.topic import Delivery  # noqa: PLC0415 - used here alone
        from services.runtime.node import Sample  # noqa: PLC0415 - used here alone

        clock = ManualClock(asyncio.get_running_loop())
        bus = MemoryBus()
        reader = MemoryNode(bus, service("reader", reads=(topics.TRAIN_TRUTH,)), TRAIN, clock)
        arrivals = reader.arrivals(topics.TRAIN_TRUTH)
        key = topics.TRAIN_TRUTH.at(TRAIN, device="front")
        newer = msgspec.msgpack.encode(msgspec.structs.asdict(truth(5)) | {"from_the_future": [1, 2]})
        for payload in (b"\xc1garbage", b"", newer, b"\x00" * 10_000_000):
            bus.put(Sample(key, payload, b"", 0), Delivery.STREAM)
        reader.stop()
        got = [a.message.t_ns async for a in arrivals]
        assert got == [5]
        return reader.health.received, reader.health.refused, reader.health.level(0.0)[1]

    received, refused, reasons = run_manual(main())
    assert (received, refused) == (1, 3)
    assert "10000000 bytes" in reasons[0]


def test_time_is_virtual() -> None:
    with manual_loop() as loop:
        ticks: list[float] = []

        async def tick() -> None:
            while True:
                await asyncio.sleep(0.1)
                ticks.append(loop.time())

        loop.create_task(tick())
        loop.advance(3600.0)
        # 36 000 ticks of 0.1 s, summed in floating point.
        assert len(ticks) in (35_999, 36_000)
        assert loop.time() == pytest.approx(3600.0)


def test_a_deadlock_names_who_waits() -> None:
    loop = ManualLoop()

    async def waits_for_ever() -> None:
        await asyncio.Event().wait()

    task = loop.create_task(waits_for_ever(), name="forgotten")
    with pytest.raises(DeadlockError, match="forgotten"):
        loop.run_until_complete(task)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        loop.run_until_complete(task)
    loop.close()


def test_sleep_tells_whether_to_go_on() -> None:
    async def main() -> tuple[bool, bool]:
        clock = ManualClock(asyncio.get_running_loop())
        node = MemoryNode(MemoryBus(), service("sleeper"), TRAIN, clock)
        first = await node.sleep(1.0)
        asyncio.get_running_loop().call_later(0.5, node.stop)
        return first, await node.sleep(10.0)

    assert run_manual(main()) == (True, False)
