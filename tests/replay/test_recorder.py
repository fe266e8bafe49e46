"""The recorder on a bus in memory, with virtual time and a real folder."""

from __future__ import annotations

import asyncio
import random
import subprocess
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from schemas import topics
from schemas.position import TrainTruth
from schemas.topic import Delivery, Place
from services.recorder.recording_file import read_recording
from services.recorder.service import SERVICE, Config
from services.runtime.catalogue import load_service
from services.runtime.clock import ManualClock
from services.runtime.manual_loop import ManualLoop, manual_loop
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Node, Sample, Service
from tests.unit.recorder.samples import START_NS, truth_sample

TRAIN = Place("demo", "train", "T1")


class Bench:
    """A bus with a recorder on it."""

    def __init__(self, loop: ManualLoop, config: Config) -> None:
        self.loop = loop
        self.clock = ManualClock(loop, START_NS)
        self.bus = MemoryBus()
        self.node = MemoryNode(self.bus, SERVICE, TRAIN, self.clock)
        self.task = loop.create_task(self.node.run(config))
        loop.settle()

    def put(self, *samples: Sample) -> None:
        for sample in samples:
            self.bus.put(sample, Delivery.STREAM)
        self.loop.settle()

    def stop(self) -> None:
        self.node.stop()
        self.loop.settle()
        assert self.task.done()
        self.task.result()


@pytest.fixture
def loop() -> Iterator[ManualLoop]:
    with manual_loop() as made:
        yield made


def samples_in(folder: Path) -> list[Sample]:
    return [sample for path in sorted(folder.glob("*.mcap")) for sample in read_recording(path)]


def test_it_is_in_the_catalogue_and_reads_everything() -> None:
    assert load_service("recorder") is SERVICE
    assert set(SERVICE.reads) == set(topics.ALL)
    assert SERVICE.writes == ()


def test_everything_on_the_bus_is_recorded_with_its_attachment(loop: ManualLoop, tmp_path: Path) -> None:
    bench = Bench(loop, Config(folder=str(tmp_path)))
    samples = [truth_sample(index) for index in range(10)]
    foreign = Sample("kirotei/v1/demo/train/T1/from/the/future", b"?", b"", START_NS)
    bench.put(*samples, foreign)
    loop.advance(5.0)
    bench.stop()
    assert samples_in(tmp_path) == [*samples, foreign]
    counts = bench.node.health.counts
    assert (counts["recorded"], counts["without_topic"], counts["lost"], counts["files"]) == (11, 1, 0, 1)
    assert bench.node.health.level(0.0)[0] == "ok"


def test_a_flush_comes_every_second(loop: ManualLoop, tmp_path: Path) -> None:
    bench = Bench(loop, Config(folder=str(tmp_path)))
    bench.put(truth_sample(0))
    loop.advance(0.9)
    before = sum(path.stat().st_size for path in tmp_path.iterdir())
    loop.advance(0.2)
    (part,) = tmp_path.iterdir()
    assert part.name.endswith(".mcap.part")
    assert before < part.stat().st_size
    bench.stop()


def test_a_key_expression_chooses(loop: ManualLoop, tmp_path: Path) -> None:
    bench = Bench(loop, Config(folder=str(tmp_path), key_expression="kirotei/v1/*/train/*/truth/rear"))
    bench.put(truth_sample(0), truth_sample(1, "rear"))
    bench.stop()
    assert samples_in(tmp_path) == [truth_sample(1, "rear")]


def test_what_the_buffer_cannot_hold_is_counted(loop: ManualLoop, tmp_path: Path) -> None:
    bench = Bench(loop, Config(folder=str(tmp_path), buffer_mb=1.0))
    noise = random.Random(1).randbytes(400_000)  # noqa: S311 - no secret
    big = [Sample("kirotei/v1/demo/noise", noise, b"", START_NS + index) for index in range(4)]
    for sample in big:
        bench.bus.put(sample, Delivery.STREAM)  # all before the loop runs
    loop.settle()
    bench.stop()
    assert len(samples_in(tmp_path)) == 2
    assert bench.node.health.counts["dropped_at_buffer"] == 2
    assert "the disk is too slow: 2 messages dropped" in bench.node.health.level(loop.time())[1]


def test_a_leftover_is_repaired_while_recording_goes_on(loop: ManualLoop, tmp_path: Path) -> None:
    bench = Bench(loop, Config(folder=str(tmp_path)))
    bench.put(*[truth_sample(index) for index in range(5)])
    loop.advance(1.1)
    (part,) = tmp_path.iterdir()
    cut = part.read_bytes()
    bench.stop()
    for path in tmp_path.iterdir():
        path.unlink()
    part.write_bytes(cut)
    again = Bench(loop, Config(folder=str(tmp_path)))
    again.put(truth_sample(9))
    assert "repaired, 5 messages saved" in again.node.health.level(loop.time())[1][0]
    again.stop()
    assert samples_in(tmp_path) == [*(truth_sample(index) for index in range(5)), truth_sample(9)]


def test_a_folder_in_use_ends_the_second_recorder(loop: ManualLoop, tmp_path: Path) -> None:
    first = Bench(loop, Config(folder=str(tmp_path)))
    second = Bench(loop, Config(folder=str(tmp_path)))
    with pytest.raises(Exception, match="another recorder writes into"):
        second.task.result()
    first.stop()


def test_a_cap_that_holds_no_two_files_is_refused() -> None:
    with pytest.raises(msgspec.ValidationError, match=r"keep_gb = 0\.1 holds less than two files"):
        msgspec.convert({"keep_gb": 0.1}, Config)


def test_a_key_expression_that_is_none_is_refused() -> None:
    with pytest.raises(msgspec.ValidationError, match="key_expression 'a//b' has an empty chunk"):
        msgspec.convert({"key_expression": "a//b"}, Config)


def test_a_full_disk_fails_health_and_recording_goes_on_when_there_is_room(loop: ManualLoop, tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["/usr/bin/env", "mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)]
    made = subprocess.run(mount, check=False, capture_output=True)
    if made.returncode != 0:
        pytest.skip(f"may not mount a tmpfs: {made.stderr.decode().strip()}")
    try:
        (disk / "ballast").write_bytes(bytes(900_000))
        _fill_and_free(loop, disk)
    finally:
        subprocess.run(["/usr/bin/env", "umount", str(disk)], check=True)


def _fill_and_free(loop: ManualLoop, disk: Path) -> None:
    bench = Bench(loop, Config(folder=str(disk), resume_free_mb=0.2, compression="none"))
    number = 0
    while bench.node.health.level(loop.time())[0] == "ok":
        bench.put(truth_sample(number, "x" * 60))
        number += 1
        assert number < 10_000
        if number % 100 == 0:
            loop.advance(1.0)
    level, reasons = bench.node.health.level(loop.time())
    assert (level, "No space left on device" in reasons[0]) == ("failed", True)
    bench.put(truth_sample(number), truth_sample(number + 1))
    loop.advance(3.0)
    assert bench.node.health.counts["lost"] == 2
    (disk / "ballast").unlink()
    loop.advance(1.0)
    assert bench.node.health.level(loop.time())[0] == "ok"
    bench.put(truth_sample(number + 2))
    bench.stop()
    assert len(samples_in(disk)) == number + 1


def test_recorder_hears_services_of_the_same_bus(loop: ManualLoop, tmp_path: Path) -> None:
    async def speak(node: Node, config: msgspec.Struct) -> None:
        del config
        for index in range(20):
            message = TrainTruth(
                t_ns=index, lat_deg=0, lon_deg=0, h_m=0, ve_mps=0, vn_mps=0, vu_mps=0, axis_m=0, speed_mps=0
            )
            await node.publish(topics.TRAIN_TRUTH, message, device="front")
            await asyncio.sleep(0.2)

    bench = Bench(loop, Config(folder=str(tmp_path), rotate_s=1.0))
    speaker = Service("speaker", msgspec.Struct, (), (topics.TRAIN_TRUTH,), speak, "a test's service")
    loop.create_task(MemoryNode(bench.bus, speaker, TRAIN, bench.clock).run(msgspec.Struct()))
    loop.advance(6.0)
    bench.stop()
    assert len(samples_in(tmp_path)) == 20
    assert bench.node.health.counts["files"] == 4
