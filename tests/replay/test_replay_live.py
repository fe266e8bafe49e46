"""Recordings onto a bus again, at their pace."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import pytest

from schemas import topics
from schemas.topic import Place, TopicError
from services.recorder.live_replay import (
    LONGEST_WAIT_S,
    Played,
    ReplayConfig,
    first_address,
    on_line,
    play,
    senders,
)
from services.recorder.mcap_file import Lane, lay
from services.runtime.attachment import Attachment, decode_attachment
from services.runtime.clock import ManualClock
from services.runtime.guest import guest
from services.runtime.manual_loop import manual_loop
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Sample
from tests.unit.recorder.samples import START_NS, truth_sample

REPLAY = guest("replay", "a replay", writes=topics.ALL)
NOW_NS = START_NS + 86_400 * 10**9
"""A day after the recording."""


def played(samples: Sequence[Sample], config: ReplayConfig, stop_after_s: float | None = None) -> list[Sample]:
    """What is heard on a bus, at virtual times."""
    heard: list[Sample] = []
    with manual_loop() as loop:
        node = MemoryNode(
            MemoryBus(on_publish=heard.append), REPLAY, Place("demo", "train", "T1"), ManualClock(loop, NOW_NS)
        )
        if stop_after_s is not None:
            loop.call_later(stop_after_s, node.stop)
        loop.run_until_complete(play(node, iter(samples), config, lambda _: None))
    return heard


def times_s(samples: Sequence[Sample]) -> list[float]:
    return [(sample.received_ns - NOW_NS) / 1e9 for sample in samples]


@pytest.mark.parametrize(("speed", "step_s"), [(1.0, 0.2), (10.0, 0.02), (0.5, 0.4), (0.0, 0.0)])
def test_messages_come_at_the_recorded_pace_times_the_speed(speed: float, step_s: float) -> None:
    heard = played([truth_sample(index) for index in range(100)], ReplayConfig(speed=speed))
    # Timers of the loop are exact to a nanosecond of a hundred sums.
    assert times_s(heard) == pytest.approx([index * step_s for index in range(100)], abs=1e-6)


def test_keys_and_bytes_are_the_original_and_the_mark_is_the_replays_own() -> None:
    samples = [truth_sample(0), truth_sample(1, "rear"), truth_sample(2)]
    heard = played(samples, ReplayConfig())
    assert [(sample.key, sample.payload) for sample in heard] == [(sample.key, sample.payload) for sample in samples]
    marks = [decode_attachment(sample.attachment) for sample in heard]
    assert marks[0] == Attachment("demo/train/T1/replay", "boot-1", 0, NOW_NS)
    assert [mark.sequence for mark in marks if mark] == [0, 0, 1]


def test_another_line_takes_every_key() -> None:
    heard = played([truth_sample(0)], ReplayConfig(line="rehearsal"))
    assert heard[0].key == "kirotei/v1/rehearsal/train/T1/truth/front"
    assert on_line("somebody/else", "rehearsal") == "somebody/else"
    lanes = [lay(truth_sample(0)).lane, Lane("k", "none")]
    assert senders(lanes, "rehearsal") == {"rehearsal/train/T1/simulator"}
    assert senders(lanes, None) == {"demo/train/T1/simulator"}
    assert first_address(lanes, "rehearsal").place == Place("rehearsal", "train", "T1")


def test_a_recording_without_known_topics_cannot_be_placed() -> None:
    with pytest.raises(TopicError, match="no message of a known topic"):
        first_address([Lane("somebody/else", "none")], None)


def test_times_that_step_back_cost_no_waiting_and_long_silence_is_cut_short() -> None:
    second_ns = 10**9
    offsets_ns = [0, second_ns, 0, second_ns, 2 * second_ns, 10**15]
    samples = [
        msgspec.structs.replace(truth_sample(index), received_ns=START_NS + offset_ns)
        for index, offset_ns in enumerate(offsets_ns)
    ]
    heard = played(samples, ReplayConfig())
    assert times_s(heard) == pytest.approx([0, 1, 1, 1, 2, 2 + LONGEST_WAIT_S], abs=1e-6)


def test_a_replay_that_is_stopped_ends_at_once() -> None:
    heard = played([truth_sample(index) for index in range(100)], ReplayConfig(), stop_after_s=0.9)
    assert len(heard) == 5


def test_keys_without_a_topic_are_counted_and_left_out() -> None:
    reports: list[Played] = []
    with manual_loop() as loop:
        node = MemoryNode(MemoryBus(), REPLAY, Place("demo", "train", "T1"), ManualClock(loop, NOW_NS))
        samples = iter([Sample("somebody/else", b"", b"", START_NS), truth_sample(0)])
        done = loop.run_until_complete(play(node, samples, ReplayConfig(speed=0.0), reports.append))
    assert (done.published, done.without_topic, done.time_ns) == (1, 1, truth_sample(0).received_ns)
    assert reports[-1] is done
