"""What a recording is said to hold."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.recorder.contents_file import contents_of
from services.recorder.mcap_file import RecordingWriter
from services.recorder.part_file import PartFile
from services.runtime.node import Sample
from tests.unit.recorder.samples import START_NS, TICK_NS, truth_sample


def write(path: Path, samples: list[Sample]) -> Path:
    part = PartFile(path)
    writer = RecordingWriter(part)
    for sample in samples:
        writer.write(sample)
    writer.finish()
    part.complete()
    return path


def test_counts_rates_senders_and_gaps(tmp_path: Path) -> None:
    front = [truth_sample(index) for index in (0, 1, 2, 5, 6)]
    front += [truth_sample(index + 7, boot_id="boot-2") for index in range(2)]
    rear = [truth_sample(index, "rear") for index in range(3)]
    foreign = Sample("somebody/else", b"12345", b"", START_NS + 8 * TICK_NS)
    contents = contents_of(write(tmp_path / "a.mcap", [*front, *rear, foreign]))
    assert (contents.complete, contents.messages, contents.faults) == (True, 11, [])
    by_key = {key.rpartition("/")[2]: entry for key, entry in contents.keys.items()}
    assert by_key["front"].topic == "truth"
    assert list(by_key["front"].senders) == ["demo/train/T1/simulator"]
    # Numbers 3 and 4, and what boot-2 had sent before its number 7.
    assert (by_key["front"].missing, by_key["front"].restarts) == (2 + 7, 1)
    assert by_key["front"].longest_silence_s == pytest.approx(0.6)
    assert by_key["front"].rate_hz == pytest.approx(6 / 1.6)
    assert by_key["rear"].missing == 0
    assert by_key["rear"].rate_hz == pytest.approx(5.0)
    assert (by_key["else"].topic, by_key["else"].octets, by_key["else"].rate_hz) == ("", 5, None)
    assert (contents.first_ns, contents.last_ns) == (front[0].received_ns, truth_sample(8).received_ns)


def test_an_empty_recording_has_no_times(tmp_path: Path) -> None:
    contents = contents_of(write(tmp_path / "a.mcap", []))
    assert (contents.complete, contents.messages, contents.first_ns, contents.last_ns) == (True, 0, None, None)


def test_a_broken_file_tells_what_is_left(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", [truth_sample(0)])
    path.write_bytes(path.read_bytes()[:-50])
    contents = contents_of(path)
    assert (contents.complete, contents.messages, len(contents.faults)) == (False, 1, 1)
    path.write_bytes(b"no recording")
    assert (contents_of(path).messages, contents_of(path).faults[0].offset) == (0, 0)
