"""The bounded queue between the transport and a service's loop, on virtual time."""

from __future__ import annotations

import asyncio
import threading

import msgspec
import pytest

from schemas import topics
from schemas.codec import MAX_MESSAGE_BYTES, encode
from schemas.gnss import Fix
from schemas.message import Message
from schemas.position import TrainTruth
from schemas.topic import Place
from schemas.topics import TABLE
from services.runtime.attachment import Attachment, encode_attachment
from services.runtime.clock import ManualClock
from services.runtime.health import HealthBoard
from services.runtime.inbox import BATCH, Inbox
from services.runtime.manual_loop import run_manual
from services.runtime.node import Arrival, Sample

PLACE = Place("demo", "train", "T1")
KEY = topics.TRAIN_TRUTH.at(PLACE, device="front")


def truth(t_ns: int) -> TrainTruth:
    return TrainTruth(
        t_ns=t_ns, lat_deg=35.0, lon_deg=135.0, h_m=0, ve_mps=0, vn_mps=0, vu_mps=0, axis_m=0, speed_mps=0
    )


def sample(number: int, *, key: str = KEY, payload: bytes | None = None, marked: bool = True) -> Sample:
    mark = encode_attachment(Attachment("demo/train/T1/sender", "boot", number, 1_000 * number)) if marked else b""
    return Sample(key, encode(truth(number)) if payload is None else payload, mark, 1_000 * number + 250)


def make(capacity: int = 10_000) -> tuple[Inbox, HealthBoard]:
    health = HealthBoard("reader", "boot", 0.0)
    return Inbox(ManualClock(asyncio.get_running_loop()), health, capacity), health


def read(*samples: Sample, capacity: int = 10_000) -> tuple[list[Arrival[Message]], HealthBoard]:
    async def main() -> tuple[list[Arrival[Message]], HealthBoard]:
        inbox, health = make(capacity)
        inbox.put(samples)
        inbox.close()
        return [arrival async for arrival in inbox.arrivals(TABLE)], health

    return run_manual(main())


def test_an_arrival_tells_everything() -> None:
    (arrival,), health = read(sample(3))
    assert arrival.message == truth(3)
    assert (arrival.key, arrival.place, arrival.fields) == (KEY, PLACE, {"device": "front"})
    assert (arrival.source, arrival.boot_id, arrival.sequence) == ("demo/train/T1/sender", "boot", 3)
    assert (arrival.sent_ns, arrival.received_ns) == (3_000, 3_250)
    assert health.received == 1
    assert health.report(0, 0.0).inputs[0].delay_s == pytest.approx(250e-9)


def test_messages_are_those_of_the_arrivals() -> None:
    async def main() -> list[Message]:
        inbox, _ = make()
        inbox.put([sample(0), sample(0), sample(1, payload=b"\xc1"), sample(2)])
        inbox.close()
        return [message async for message in inbox.messages(TABLE)]

    assert run_manual(main()) == [truth(0), truth(2)]


def test_a_sample_without_mark_is_a_message_of_nobody() -> None:
    (arrival, again), health = read(sample(1, marked=False), sample(1, marked=False))
    assert (arrival.source, arrival.boot_id, arrival.sequence, arrival.sent_ns) == ("", "", -1, 0)
    assert again.message == arrival.message
    assert health.report(0, 0.0).inputs == ()


def test_a_gap_in_a_state_is_counted_but_no_trouble() -> None:
    key = topics.GNSS_FIX.at(PLACE, device="front")
    fix = Fix(t_ns=0, gps_week=2400, tow_s=0, method="original", status="none", satellites_used=0, satellites_flagged=0)
    for name, payload, troubled in ((key, encode(fix), False), (KEY, None, True)):
        arrivals, health = read(*(sample(number, key=name, payload=payload) for number in (0, 3)))
        assert [a.sequence for a in arrivals] == [0, 3]
        assert health.report(0, 0.0).inputs[0].missing == 2
        assert (health.level(0.0)[0] == "degraded") == troubled
        assert bool(health.take_notices()) == troubled


def test_what_cannot_be_used_is_counted_with_its_reason() -> None:
    bad = (
        (sample(0, payload=b"\xc1"), "TrainTruth"),
        (sample(0, payload=b""), "from demo/train/T1/sender"),
        (sample(0, payload=b"\x00" * (MAX_MESSAGE_BYTES + 1)), f"{MAX_MESSAGE_BYTES + 1} bytes"),
        (sample(0, payload=msgspec.msgpack.encode({"t_ns": "noon"})), "t_ns"),
        (sample(0, payload=b"\x81\xa4t_ns\xcf" + b"\xff" * 8, marked=False), "an unknown sender"),
        (sample(0, key="kirotei/v1/demo/train/T1/what/is/this"), "no topic has the key"),
    )
    for wrong, reason in bad:
        arrivals, health = read(wrong)
        assert arrivals == []
        assert (health.received, health.refused) == (0, 1)
        assert reason in health.level(0.0)[1][0]


def test_the_oldest_are_pushed_out_and_counted() -> None:
    arrivals, health = read(*(sample(number) for number in range(10)), capacity=4)
    assert [a.sequence for a in arrivals] == [6, 7, 8, 9]
    assert health.dropped == 6
    assert "full inbox (4) pushed out 6" in health.level(0.0)[1][0]


def test_more_than_a_batch_lets_others_have_their_turn() -> None:
    async def main() -> tuple[int, int]:
        inbox, _ = make()
        inbox.put([sample(number) for number in range(3 * BATCH)])
        turns = 0

        async def other() -> None:
            nonlocal turns
            while True:
                turns += 1
                await asyncio.sleep(0)

        task = asyncio.get_running_loop().create_task(other())
        inbox.close()
        count = len([arrival async for arrival in inbox.arrivals(TABLE)])
        task.cancel()
        return count, turns

    # Between three batches there are two gaps.
    assert run_manual(main()) == (3 * BATCH, 2)


def test_closed_inboxes_take_nothing_more() -> None:
    async def main() -> list[int]:
        inbox, _ = make()
        inbox.put([sample(0)])
        inbox.close()
        inbox.put([sample(1)])
        inbox.put_inline(sample(2))
        return [int.from_bytes(s.payload[:0]) + s.received_ns async for s in inbox.samples()]

    assert run_manual(main()) == [250]


def test_a_reader_that_leaves_closes_its_inbox() -> None:
    async def main() -> bool:
        inbox, _ = make()
        inbox.put([sample(0), sample(1)])
        arrivals = inbox.arrivals(TABLE)
        await anext(arrivals)
        assert not inbox.closed
        await arrivals.aclose()  # type: ignore[attr-defined]  # an async generator, promised as an iterator only
        return inbox.closed

    assert run_manual(main())


def test_crowded_means_more_than_half_full() -> None:
    async def main() -> list[bool]:
        inbox, _ = make(4)
        crowded = []
        for number in range(4):
            crowded.append(inbox.crowded)
            inbox.put([sample(number)])
        return crowded

    assert run_manual(main()) == [False, False, False, True]


def test_losses_reported_by_the_transport_are_counted() -> None:
    async def main() -> HealthBoard:
        inbox, health = make()
        inbox.count_lost("some/key", 3)
        inbox.refuse("some/key: 10000000 bytes")
        await asyncio.sleep(0)
        return health

    health = run_manual(main())
    assert (health.counts, health.refused) == ({"lost": 3}, 1)
    assert health.level(0.0)[1] == ("3 lost for good on some/key", "refused: some/key: 10000000 bytes")


async def test_threads_fill_an_inbox_together() -> None:
    inbox, health = make_live()
    arrivals = inbox.samples()

    def fill(first: int) -> None:
        for number in range(first, first + 1000):
            inbox.put([sample(number, key=f"{KEY}/{first}")])

    threads = [threading.Thread(target=fill, args=(1000 * index,)) for index in range(4)]
    for thread in threads:
        thread.start()
    heard = [await anext(arrivals) for _ in range(4000)]
    for thread in threads:
        thread.join()
    for index in range(4):
        own = [s.received_ns for s in heard if s.key == f"{KEY}/{1000 * index}"]
        assert own == [1000 * number + 250 for number in range(1000 * index, 1000 * index + 1000)]
    assert health.dropped == 0


def make_live() -> tuple[Inbox, HealthBoard]:
    """Inbox on the test's own loop; its clock only has to stand still."""
    health = HealthBoard("reader", "boot", 0.0)
    return Inbox(ManualClock(asyncio.get_running_loop()), health, 10_000), health


def test_a_transport_that_outlives_the_loop_is_harmless() -> None:
    async def main() -> Inbox:
        return make()[0]

    inbox = run_manual(main())
    inbox.put([sample(0)])
    assert inbox.closed
