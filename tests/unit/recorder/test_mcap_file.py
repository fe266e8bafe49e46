"""What goes into a recording comes out of it unchanged."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from schemas import topics
from schemas.codec import decode
from schemas.position import TrainTruth
from services.recorder import mcap_file
from services.recorder.mcap_file import ChannelsExhaustedError, RecordingWriter, UnrecordableError, lay, lift
from services.recorder.recording_file import Fault, Scanner
from services.runtime.node import Sample
from tests.unit.recorder.samples import TRAIN, any_sample, truth_sample


def recording(samples: list[Sample], compression: mcap_file.Compression = "zstd", flush_every: int = 7) -> bytes:
    sink = io.BytesIO()
    writer = RecordingWriter(sink, compression)
    for index, sample in enumerate(samples):
        writer.write(sample)
        if index % flush_every == flush_every - 1:
            writer.flush()
    writer.finish()
    return sink.getvalue()


def scanned(octets: bytes) -> tuple[list[Sample], list[Fault]]:
    faults: list[Fault] = []
    samples = list(Scanner(io.BytesIO(octets), faults.append).samples())
    return samples, faults


@given(any_sample)
def test_a_sample_is_laid_and_lifted_unchanged(sample: Sample) -> None:
    assert lift(lay(sample), sample.received_ns) == sample


@settings(max_examples=60)
@given(st.lists(any_sample, max_size=30), st.sampled_from(["zstd", "none"]))
def test_what_is_written_is_read_back_in_order(samples: list[Sample], compression: mcap_file.Compression) -> None:
    assert scanned(recording(samples, compression)) == (samples, [])


@settings(max_examples=20)
@given(st.lists(any_sample, max_size=20))
def test_the_same_samples_give_the_same_bytes(samples: list[Sample]) -> None:
    assert recording(samples) == recording(samples)


def test_an_empty_recording_is_complete() -> None:
    assert scanned(recording([])) == ([], [])
    assert list(make_reader(io.BytesIO(recording([]))).iter_messages()) == []


def test_the_stock_reader_finds_messages_schemas_and_senders() -> None:
    samples = [truth_sample(index) for index in range(20)] + [truth_sample(0, boot_id="boot-2")]
    reader = make_reader(io.BytesIO(recording(samples)), validate_crcs=True)
    found = list(reader.iter_messages(log_time_order=False))
    assert [message.data for _, _, message in found] == [sample.payload for sample in samples]
    assert [message.sequence for _, _, message in found] == [*range(20), 0]
    schema, channel, message = found[0]
    assert schema is not None
    assert (schema.name, schema.encoding) == ("position.TrainTruth", "jsonschema")
    assert "TrainTruth" in json.loads(schema.data)["$defs"]
    assert channel.topic == topics.TRAIN_TRUTH.at(TRAIN, device="front")
    assert channel.message_encoding == "msgpack"
    assert channel.metadata == {
        "attachment": "kirotei",
        "source": "demo/train/T1/simulator",
        "boot_id": "boot-1",
        "topic": "train/{train}/truth/{device}",
        "delivery": "stream",
    }
    assert found[-1][1].metadata["boot_id"] == "boot-2"
    assert message.log_time - message.publish_time == 200_000
    assert decode(TrainTruth, message.data).axis_m == 0.0
    statistics = reader.get_summary()
    assert statistics is not None
    assert statistics.statistics is not None
    assert statistics.statistics.message_count == 21


def test_times_out_of_order_keep_the_order_of_arrival() -> None:
    samples = [truth_sample(index) for index in (5, 3, 9, 0)]
    assert scanned(recording(samples))[0] == samples


def test_no_library_version_stands_in_the_file() -> None:
    assert make_reader(io.BytesIO(recording([]))).get_header().library == "kirotei recorder 1"


@pytest.mark.parametrize("received_ns", [-1, 2**64])
def test_a_time_that_mcap_cannot_hold_is_refused(received_ns: int) -> None:
    writer = RecordingWriter(io.BytesIO())
    with pytest.raises(UnrecordableError, match=f"somebody/else: time of reception {received_ns} ns"):
        writer.write(Sample("somebody/else", b"", b"", received_ns))
    assert writer.messages == 0


def test_a_file_without_channels_left_says_so_and_stays_usable() -> None:
    sink = io.BytesIO()
    writer = RecordingWriter(sink)
    for index in range(mcap_file.MAX_CHANNELS):
        writer.write(Sample(f"k/{index}", b"x", b"", 0))
    with pytest.raises(ChannelsExhaustedError, match="already has 60000 channels"):
        writer.write(Sample("one/more", b"x", b"", 0))
    writer.write(Sample("k/0", b"y", b"", 1))
    writer.finish()
    samples, faults = scanned(sink.getvalue())
    assert (len(samples), samples[-1].payload, faults) == (mcap_file.MAX_CHANNELS + 1, b"y", [])


def test_a_foreign_recording_without_our_metadata_is_read(tmp_path: Path) -> None:
    from mcap.writer import IndexType, Writer  # noqa: PLC0415 - used here alone

    path = tmp_path / "foreign.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False, index_types=IndexType.NONE)
        writer.start()
        channel = writer.register_channel("/imu", "json", 0)
        writer.add_message(channel, 5, b"{}", 4, 3)
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves the return type out
    assert scanned(path.read_bytes()) == ([Sample("/imu", b"{}", b"", 5)], [])
