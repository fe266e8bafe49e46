"""Broken recordings: what is certain is saved, nothing is ever altered, nothing crashes."""

from __future__ import annotations

import io
import random
from pathlib import Path

import pytest

from services.recorder.mcap_file import Compression, RecordingWriter
from services.recorder.recording_file import Fault, RecordingError, Scanner, read_recording, require_complete
from services.recorder.repaired_file import repair
from services.runtime.node import Sample
from tests.unit.recorder.samples import truth_sample

SAMPLES = [truth_sample(index, device) for index in range(30) for device in ("front", "rear")]
FLUSHED = (0, 20, 40, 60)


def recording(compression: Compression = "zstd", *, finish: bool = True) -> tuple[bytes, list[int]]:
    """Bytes of SAMPLES in three chunks, and where each flush ended."""
    sink = io.BytesIO()
    writer = RecordingWriter(sink, compression)
    ends = [sink.tell()]
    for index, sample in enumerate(SAMPLES):
        writer.write(sample)
        if index + 1 in FLUSHED:
            writer.flush()
            ends.append(sink.tell())
    if finish:
        writer.finish()
    return sink.getvalue(), ends


def scanned(octets: bytes) -> tuple[list[Sample], list[Fault], Scanner]:
    faults: list[Fault] = []
    scanner = Scanner(io.BytesIO(octets), faults.append)
    return list(scanner.samples()), faults, scanner


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_cut_anywhere_gives_exactly_what_was_flushed(compression: Compression) -> None:
    octets, ends = recording(compression)
    chunks_end = [_end_of_chunk(octets, start) for start in ends[:-1]]
    for cut in {*range(0, len(octets), 13), *range(len(octets) - 60, len(octets)), *ends, *chunks_end}:
        samples, faults, scanner = scanned(octets[:cut])
        whole = sum(end <= cut for end in chunks_end)
        assert samples == SAMPLES[: FLUSHED[whole]], cut
        assert len(faults) == 1, cut
        assert not scanner.finished


def _end_of_chunk(octets: bytes, start: int) -> int:
    """Where the chunk record ends that begins at `start` (its message indexes follow)."""
    return start + 9 + int.from_bytes(octets[start + 1 : start + 9], "little")


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_one_flipped_byte_never_alters_a_message(compression: Compression) -> None:
    octets, _ = recording(compression)
    truth = set(SAMPLES)
    rng = random.Random(1)  # noqa: S311 - positions to break, no secret
    for place in rng.sample(range(len(octets)), 400):
        broken = bytearray(octets)
        broken[place] ^= 1 << rng.randrange(8)
        samples, _, _ = scanned(bytes(broken))
        assert set(samples) <= truth, place
        assert len(samples) == len(set(samples)), place


def test_a_file_cut_after_a_crash_becomes_complete(tmp_path: Path) -> None:
    octets, ends = recording()
    part = tmp_path / "a.mcap.part"
    part.write_bytes(octets[: ends[2] + 100])
    done = repair(part)
    assert (done.outcome, done.output, done.kept) == ("repaired", tmp_path / "a.mcap", None)
    assert (done.messages, done.lost_bytes) == (40, 100)
    assert done.faults == (f"byte {ends[2]}: ends in the middle of a record, 100 bytes cannot be used",)
    require_complete(tmp_path / "a.mcap")
    assert list(read_recording(tmp_path / "a.mcap")) == SAMPLES[:40]
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_a_complete_file_under_its_part_name_is_renamed(tmp_path: Path) -> None:
    part = tmp_path / "a.mcap.part"
    part.write_bytes(recording()[0])
    assert repair(part).outcome == "complete"
    assert list(read_recording(tmp_path / "a.mcap")) == SAMPLES


def test_a_complete_file_is_left_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    octets = recording()[0]
    path.write_bytes(octets)
    assert repair(path).outcome == "complete"
    assert path.read_bytes() == octets


def test_a_damaged_chunk_costs_its_own_messages_and_the_broken_file_is_kept(tmp_path: Path) -> None:
    octets, ends = recording()
    broken = bytearray(octets)
    broken[ends[0] + 200] ^= 0xFF
    path = tmp_path / "a.mcap"
    path.write_bytes(broken)
    done = repair(path)
    assert (done.outcome, done.messages, done.lost_messages) == ("repaired", 40, 20)
    assert list(read_recording(path)) == SAMPLES[20:]
    assert done.kept == tmp_path / "a.mcap.damaged"
    assert done.kept.read_bytes() == bytes(broken)


@pytest.mark.parametrize("octets", [b"", recording(finish=False)[0][: recording()[1][0]]])
def test_a_part_with_nothing_in_it_is_removed(tmp_path: Path, octets: bytes) -> None:
    part = tmp_path / "a.mcap.part"
    part.write_bytes(octets)
    assert repair(part).outcome == "empty"
    assert list(tmp_path.iterdir()) == []


def test_garbage_is_named_and_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"this is no recording" * 50)
    done = repair(path)
    assert (done.outcome, done.kept) == ("hopeless", path)
    assert done.faults[0] == "byte 0: not an MCAP recording: its first bytes are others"
    with pytest.raises(RecordingError, match=r"a\.mcap: byte 0: not an MCAP recording"):
        list(read_recording(path))
    with pytest.raises(RecordingError, match=r"a\.mcap: not an MCAP recording"):
        require_complete(path)


def test_a_finished_recording_of_that_name_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"precious")
    part = tmp_path / "a.mcap.part"
    part.write_bytes(recording(finish=False)[0])
    with pytest.raises(FileExistsError, match="move it away"):
        repair(part)
    assert (tmp_path / "a.mcap").read_bytes() == b"precious"


def test_reading_an_unfinished_file_says_how_to_save_it(tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    path.write_bytes(recording(finish=False)[0])
    with pytest.raises(RecordingError, match=r"cut\.mcap: unfinished recording; `kirotei recording repair"):
        require_complete(path)
    with pytest.raises(RecordingError, match=r"cut\.mcap: byte \d+: ends without its index; `kirotei recording repair"):
        list(read_recording(path))
