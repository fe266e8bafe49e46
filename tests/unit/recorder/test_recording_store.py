"""A folder of recordings: rotation, cap, names, and disks that take nothing any more."""

from __future__ import annotations

import random
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from services.recorder.recording_file import read_recording
from services.recorder.recording_store import FolderInUseError, RecordingStore, StoreSettings
from services.runtime.node import Sample
from tests.unit.recorder.samples import START_NS, truth_sample


def settings(folder: Path, **changes: object) -> StoreSettings:
    plain = StoreSettings(folder, 10**9, None, None, 100_000, "zstd", fsync=False)
    return replace(plain, **changes)  # type: ignore[arg-type]  # fields by name


def noisy(index: int) -> Sample:
    """40 kB that do not compress, so that sizes on disk are known."""
    noise = random.Random(index).randbytes(40_000)  # noqa: S311 - no secret
    return Sample("kirotei/v1/demo/noise", noise + index.to_bytes(4, "little"), b"", START_NS + index * 1_000_000)


def recorded(folder: Path) -> list[Sample]:
    return [sample for path in sorted(folder.glob("*.mcap")) for sample in read_recording(path)]


def test_one_file_named_by_its_first_message(tmp_path: Path) -> None:
    store = RecordingStore(settings(tmp_path / "new" / "folder"))
    assert store.open() == []
    store.write([truth_sample(0), truth_sample(1)])
    store.flush()
    assert [p.name for p in (tmp_path / "new" / "folder").iterdir()] == ["kirotei-20260301T100000.000Z-0001.mcap.part"]
    store.close()
    assert [p.name for p in (tmp_path / "new" / "folder").iterdir()] == ["kirotei-20260301T100000.000Z-0001.mcap"]
    assert recorded(tmp_path / "new" / "folder") == [truth_sample(0), truth_sample(1)]
    assert (store.recorded, store.files, store.lost) == (2, 1, 0)


def test_nothing_recorded_leaves_no_file(tmp_path: Path) -> None:
    store = RecordingStore(settings(tmp_path))
    store.open()
    store.flush()
    store.close()
    assert list(tmp_path.iterdir()) == []


def test_files_rotate_by_size_without_losing_a_message(tmp_path: Path) -> None:
    store = RecordingStore(settings(tmp_path, rotate_bytes=3_000_000))
    store.open()
    samples = [noisy(index) for index in range(300)]
    for start in range(0, 300, 10):
        store.write(samples[start : start + 10])
        store.flush()
    store.close()
    sizes = [path.stat().st_size for path in sorted(tmp_path.iterdir())]
    assert recorded(tmp_path) == samples
    # 12 MB of noise; a file may be a batch of 400 kB and its index over the limit.
    assert len(sizes) == 4
    assert max(sizes) < 3_450_000


def test_files_rotate_by_age_of_the_messages(tmp_path: Path) -> None:
    store = RecordingStore(settings(tmp_path, rotate_ns=1_000_000_000))
    store.open()
    samples = [truth_sample(index) for index in range(12)]
    store.write(samples)
    store.close()
    found = [len(list(read_recording(path))) for path in sorted(tmp_path.iterdir())]
    assert found == [5, 5, 2]
    assert recorded(tmp_path) == samples


def test_a_clock_that_steps_back_starts_no_new_file(tmp_path: Path) -> None:
    store = RecordingStore(settings(tmp_path, rotate_ns=1_000_000_000))
    store.open()
    samples = [truth_sample(index) for index in (100, 0, 1)]
    store.write(samples)
    store.close()
    assert recorded(tmp_path) == samples
    assert store.files == 1


def test_the_oldest_own_files_go_when_the_cap_is_reached(tmp_path: Path) -> None:
    (tmp_path / "mine.mcap").write_bytes(bytes(5_000_000))
    store = RecordingStore(settings(tmp_path, rotate_bytes=1_000_000, keep_bytes=4_000_000))
    store.open()
    for index in range(300):
        store.write([noisy(index)])
        if index % 10 == 9:
            store.flush()
    store.close()
    own = sorted(tmp_path.glob("kirotei-*.mcap"))
    assert sum(path.stat().st_size for path in own) <= 4_000_000
    assert store.deleted > 0
    assert store.files == store.deleted + len(own)
    assert list(read_recording(own[-1]))[-1] == noisy(299)
    assert (tmp_path / "mine.mcap").exists()


def test_a_name_that_is_taken_is_not_overwritten(tmp_path: Path) -> None:
    for _ in range(2):
        store = RecordingStore(settings(tmp_path))
        store.open()
        store.write([truth_sample(0)])
        store.close()
    assert [p.name[-9:-5] for p in sorted(tmp_path.iterdir())] == ["0001", "0002"]


def test_two_recorders_cannot_share_a_folder(tmp_path: Path) -> None:
    first = RecordingStore(settings(tmp_path))
    first.open()
    with pytest.raises(FolderInUseError, match="give each a folder of its own"):
        RecordingStore(settings(tmp_path)).open()
    first.close()
    second = RecordingStore(settings(tmp_path))
    second.open()
    second.close()


def test_a_sample_from_before_1970_is_counted_and_makes_no_file(tmp_path: Path) -> None:
    store = RecordingStore(settings(tmp_path))
    store.open()
    store.write([Sample("k", b"", b"", -1)])
    store.close()
    assert (store.unrecordable, store.recorded, list(tmp_path.iterdir())) == (1, 0, [])


def test_leftovers_are_found_and_repaired_while_garbage_is_put_aside(tmp_path: Path) -> None:
    store = RecordingStore(settings(tmp_path))
    store.open()
    store.write([truth_sample(index) for index in range(5)])
    store.flush()
    cut = (tmp_path / "kirotei-20260301T100000.000Z-0001.mcap.part").read_bytes()
    store.close()
    next(tmp_path.iterdir()).unlink()
    (tmp_path / "kirotei-20260301T100000.000Z-0001.mcap.part").write_bytes(cut + b"half a chunk")
    (tmp_path / "kirotei-20260301T110000.000Z-0002.mcap.part").write_bytes(b"no recording")
    (tmp_path / "somebody.mcap.part").write_bytes(b"not ours")
    again = RecordingStore(settings(tmp_path))
    told = [again.repair_leftover(path) for path in again.open()]
    again.close()
    assert told[0].startswith("kirotei-20260301T100000.000Z-0001.mcap.part of an earlier run: repaired, 5 messages")
    assert "not an MCAP recording" in told[1]
    assert recorded(tmp_path) == [truth_sample(index) for index in range(5)]
    assert sorted(path.name for path in tmp_path.iterdir())[1:] == [
        "kirotei-20260301T110000.000Z-0002.mcap.part.damaged",
        "somebody.mcap.part",
    ]


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of two megabytes."""
    disk = tmp_path / "disk"
    disk.mkdir()
    made = subprocess.run(
        ["/usr/bin/env", "mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(disk)], check=False, capture_output=True
    )
    if made.returncode != 0:
        pytest.skip(f"may not mount a tmpfs: {made.stderr.decode().strip()}")
    yield disk
    subprocess.run(["/usr/bin/env", "umount", str(disk)], check=True)


def test_a_full_disk_is_told_and_survived(tiny_disk: Path) -> None:
    store = RecordingStore(settings(tiny_disk, rotate_bytes=500_000))
    store.open()
    index = 0
    while store.fault is None:
        store.write([noisy(index)])
        store.flush()
        index += 1
        assert index < 100
    assert "No space left on device" in store.fault
    store.write([noisy(index), noisy(index + 1)])
    store.flush()
    assert store.fault is not None
    assert store.lost == 2
    min(tiny_disk.glob("*.mcap")).unlink()
    store.flush()
    assert store.fault is None
    store.write([noisy(index + 2)])
    store.close()
    found = [int.from_bytes(sample.payload[-4:], "little") for sample in recorded(tiny_disk)]
    missing = set(range(found[0], index + 3)) - set(found)
    # What came while the disk was full is lost, and nothing else; what was held back is there.
    assert missing == {index, index + 1}
    assert list(tiny_disk.glob("*.part")) == []


def test_a_disk_that_stays_full_keeps_what_it_has(tiny_disk: Path) -> None:
    store = RecordingStore(settings(tiny_disk))
    store.open()
    index = 0
    while store.fault is None:
        store.write([noisy(index)])
        store.flush()
        index += 1
        assert index < 100
    store.close()
    (part,) = tiny_disk.glob("*.part")
    assert "left unfinished" in store.take_notes()[0]
    assert store.recorded + store.lost == index
    shutil.copy(part, tiny_disk.parent)
    store = RecordingStore(settings(tiny_disk.parent))
    store.open()
    assert f"repaired, {store.recorded + index - 1} messages" in store.repair_leftover(tiny_disk.parent / part.name)
    store.close()
    assert recorded(tiny_disk.parent) == [noisy(number) for number in range(index - 1)]


LIMITED = """
import resource, sys
from pathlib import Path
from services.recorder.recording_store import RecordingStore
from tests.unit.recorder.test_recording_store import noisy, settings
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
store = RecordingStore(settings(Path(sys.argv[1])))
store.open()
faults = 0
for index in range(30):
    store.write([noisy(index)])
    store.flush()
    faults += store.fault is not None
print(faults, store.recorded, store.lost)
store.close()
"""


def test_a_file_that_may_not_grow_further_is_given_up_for_a_new_one(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(tmp_path)], check=True, capture_output=True, timeout=60, text=True
    )
    faults, recorded_count, lost = map(int, done.stdout.split())
    assert (recorded_count + lost, faults > 0) == (30, True)
    store = RecordingStore(settings(tmp_path))
    for path in store.open():
        store.repair_leftover(path)
    store.close()
    assert len(recorded(tmp_path)) == recorded_count
