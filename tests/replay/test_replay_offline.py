"""Recordings through services again, in virtual time."""

from __future__ import annotations

import asyncio
import io

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas import topics
from schemas.codec import decode
from schemas.gnss import Fix
from schemas.topic import Place
from services.recorder.mcap_file import RecordingWriter
from services.recorder.offline_replay import ReplayError, replay_through
from services.runtime.attachment import Attachment, decode_attachment, encode_attachment
from services.runtime.guest import guest
from services.runtime.node import Node, Sample, Service
from tests.unit.recorder.samples import START_NS, TICK_NS, truth_sample


class TickerConfig(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of a test's service."""

    tick_s: float = 1.0
    fail_at: int | None = None


async def tick(node: Node, config: TickerConfig) -> None:
    """Publish a fix for every truth, and one every `tick_s` with the number of truths so far."""
    heard = 0

    async def count() -> None:
        while await node.sleep(config.tick_s):
            await node.publish(topics.GNSS_COMPARISON, _fix(node, heard), device="front", method="original")

    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(count())
        node.ready()
        async for message in node.messages(topics.TRAIN_TRUTH):
            heard += 1
            if heard == config.fail_at:
                msg = "the sky fell"
                raise ValueError(msg)
            await node.publish(topics.GNSS_FIX, _fix(node, round(message.axis_m)), device="front")


def _fix(node: Node, count: int) -> Fix:
    return Fix(
        t_ns=node.clock.now_ns(),
        gps_week=0,
        tow_s=0.0,
        method="original",
        status="none",
        satellites_used=count,
        satellites_flagged=0,
    )


TICKER = Service(
    "ticker",
    TickerConfig,
    (topics.TRAIN_TRUTH,),
    (topics.GNSS_FIX, topics.GNSS_COMPARISON),
    tick,
    "a test's service",
)


async def relay(node: Node, config: TickerConfig) -> None:
    """Publish every fix again as a comparison."""
    del config
    async for arrival in node.arrivals(topics.GNSS_FIX):
        await node.publish(topics.GNSS_COMPARISON, arrival.message, device="front", method="adjust")


RELAY = Service("relay", TickerConfig, (topics.GNSS_FIX,), (topics.GNSS_COMPARISON,), relay, "a test's service")


def octets_of(samples: list[Sample]) -> bytes:
    sink = io.BytesIO()
    writer = RecordingWriter(sink)
    for sample in samples:
        writer.write(sample)
    writer.finish()
    return sink.getvalue()


def fixes(samples: list[Sample]) -> list[tuple[int, str, int]]:
    """Virtual time in 0.1 s, last chunk of the key, and count of each publication."""
    return [
        (
            round((sample.received_ns - START_NS) / 1e8),
            sample.key.rpartition("/")[2],
            decode(Fix, sample.payload).satellites_used,
        )
        for sample in samples
    ]


def test_services_hear_messages_at_their_recorded_times_and_their_timers_run_between() -> None:
    heard = replay_through([truth_sample(index) for index in range(8)], [TICKER])
    found = fixes(heard)
    assert [entry for entry in found if entry[1] == "fix"] == [(2 * index, "fix", 3 * index) for index in range(8)]
    # It started with the first message, so its tick falls between the sixth and the seventh.
    assert [entry for entry in found if entry[1] == "original"] == [(10, "original", 5)]


def test_publications_carry_virtual_times_and_a_boot_id_that_can_be_repeated() -> None:
    heard = replay_through([truth_sample(0), truth_sample(1)], [TICKER])
    marks = [decode_attachment(sample.attachment) for sample in heard]
    first_ns = truth_sample(0).received_ns
    assert marks == [
        Attachment("demo/train/T1/ticker", "boot-1", 0, first_ns),
        Attachment("demo/train/T1/ticker", "boot-1", 1, first_ns + TICK_NS),
    ]


@settings(max_examples=25)
@given(st.lists(st.integers(0, 200), max_size=30), st.sampled_from([0.05, 0.3, 1.0]))
def test_the_same_recording_gives_the_same_bytes(order: list[int], tick_s: float) -> None:
    samples = [truth_sample(index) for index in order]
    once, again = (
        octets_of(replay_through(iter(samples), [TICKER, RELAY], {"ticker": TickerConfig(tick_s=tick_s)}))
        for _ in range(2)
    )
    assert once == again


def test_what_the_services_published_when_it_was_recorded_is_not_fed_again() -> None:
    inputs = [truth_sample(index) for index in range(5)]
    outputs = replay_through(inputs, [TICKER])
    foreign = msgspec.structs.replace(outputs[0], attachment=_mark("demo/train/T1/somebody", 9))
    replayed = msgspec.structs.replace(outputs[1], attachment=_mark("demo/train/T1/replay", 7))
    recording = sorted([*inputs, *outputs, foreign, replayed], key=lambda sample: sample.received_ns)
    assert replay_through(recording, [TICKER]) == outputs
    both = fixes(replay_through(recording, [TICKER, RELAY]))
    # Five fixes made anew and the one of somebody else; the replayed one may have been the ticker's.
    assert sum(entry[1] == "adjust" for entry in both) == 6
    alone = fixes(replay_through(recording, [RELAY]))
    assert sum(entry[1] == "adjust" for entry in alone) == 7


def _mark(source: str, sequence: int) -> bytes:
    return encode_attachment(Attachment(source, "b", sequence, 0))


def test_one_run_of_the_service_for_every_train() -> None:
    other = "kirotei/v1/demo/train/T2/truth/front"
    samples = [
        truth_sample(0),
        Sample(other, truth_sample(1).payload, b"", truth_sample(1).received_ns),
        truth_sample(2),
    ]
    heard = replay_through(samples, [TICKER])
    assert [sample.key.split("/")[4] for sample in heard] == ["T1", "T2", "T1"]
    only = replay_through(samples, [TICKER], place=Place("demo", "train", "T2"))
    assert [sample.key.split("/")[4] for sample in only] == ["T2"]


def test_a_service_that_raises_ends_the_replay_with_its_name_and_time() -> None:
    samples = [truth_sample(index) for index in range(8)]
    with pytest.raises(ReplayError, match=r"demo/train/T1/ticker failed at 2026-03-01 10:00:00 UTC, after 4 messages"):
        replay_through(samples, [TICKER], {"ticker": TickerConfig(fail_at=4)})


def test_a_failure_at_the_very_end_is_seen() -> None:
    with pytest.raises(ReplayError, match="the sky fell"):
        replay_through([truth_sample(0)], [TICKER], {"ticker": TickerConfig(fail_at=1)})


def test_a_service_that_does_not_end_is_named() -> None:
    async def stubborn(node: Node, config: TickerConfig) -> None:
        del config
        node.messages(topics.TRAIN_TRUTH)
        await asyncio.Event().wait()

    service = Service("stubborn", TickerConfig, (topics.TRAIN_TRUTH,), (), stubborn, "a test's service")
    with pytest.raises(ReplayError, match="stubborn at demo/train/T1 does not end 60 s after it was asked to"):
        replay_through([truth_sample(0)], [service])


def test_a_service_of_another_kind_of_place_needs_to_be_told_where() -> None:
    reads = (topics.SERVICE_EVENT,)
    service = guest("onboard", "a test's service", reads=reads, writes=(topics.GNSS_FIX,))
    event = Sample("kirotei/v1/demo/wayside/W1/event/x", b"", b"", START_NS)
    with pytest.raises(ReplayError, match=r"onboard works at a train, not at demo/wayside/W1: say where with --place"):
        replay_through([event], [service])


def test_nothing_recorded_gives_nothing() -> None:
    assert replay_through([], [TICKER]) == []
    unread = Sample(topics.HEALTH.at(Place("demo", "train", "T1"), service="x"), b"", b"", START_NS)
    assert replay_through([unread], [TICKER]) == []


def test_a_calendar_that_was_set_passes_in_no_time() -> None:
    year_ns = 365 * 86_400 * 1_000_000_000
    offsets_ns = [0, TICK_NS, 10 * year_ns, 10 * year_ns + TICK_NS, 0, TICK_NS]
    samples = [
        msgspec.structs.replace(truth_sample(index), received_ns=START_NS + offset_ns)
        for index, offset_ns in enumerate(offsets_ns)
    ]
    heard = fixes(replay_through(samples, [TICKER], {"ticker": TickerConfig(tick_s=600.0)}))
    times = [time for time, name, _ in heard if name == "fix"]
    assert times == [round(offset_ns / 1e8) for offset_ns in offsets_ns]
    # Of ten silent years one hour passes: six ticks.
    assert len([entry for entry in heard if entry[1] == "original"]) == 6


def test_garbage_in_a_recording_is_counted_by_the_service_and_nothing_else_happens() -> None:
    garbage = msgspec.structs.replace(truth_sample(0), payload=b"\xc1")
    assert len(replay_through([garbage, truth_sample(1)], [TICKER])) == 1
