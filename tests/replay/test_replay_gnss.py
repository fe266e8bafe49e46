"""A simulated train, its positions and the recorder on one bus; then the recording replayed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from schemas import topics
from schemas.message import Message
from schemas.topic import Topic
from schemas.topics import topic_of
from services.gnss_correction.service import SERVICE as CORRECTION
from services.gnss_correction.settings import Config as CorrectionConfig
from services.recorder.offline_replay import replay_through
from services.recorder.recording_file import read_recording
from services.recorder.service import SERVICE as RECORDER
from services.recorder.service import Config as RecorderConfig
from services.runtime.clock import ManualClock
from services.runtime.manual_loop import manual_loop
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Sample
from services.simulator.service import SERVICE as SIMULATOR
from services.simulator.service import Config as SimulatorConfig
from tests.unit.recorder.samples import START_NS, TRAIN

DRIVE_S = 20.0
OUTPUTS = (topics.GNSS_FIX, topics.GNSS_COMPARISON, topics.GNSS_VERDICT)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty seconds of a train in a street canyon."""
    folder = tmp_path_factory.mktemp("recordings")
    with manual_loop() as loop:
        bus, clock = MemoryBus(), ManualClock(loop, START_NS)
        runs = [
            (MemoryNode(bus, RECORDER, TRAIN, clock), RecorderConfig(folder=str(folder), fsync=False)),
            (MemoryNode(bus, CORRECTION, TRAIN, clock), CorrectionConfig()),
            (MemoryNode(bus, SIMULATOR, TRAIN, clock), SimulatorConfig()),
        ]
        tasks = [loop.create_task(node.run(config)) for node, config in runs]
        loop.advance(DRIVE_S)
        for node, _ in reversed(runs):
            node.stop()
            loop.settle()
        for task in tasks:
            task.result()
    (path,) = folder.iterdir()
    return path


def of(samples: list[Sample], *wanted: Topic[Message]) -> list[Sample]:
    found = ((sample, topic_of(sample.key)) for sample in samples)
    return [sample for sample, address in found if address is not None and address.topic in wanted]


def test_what_was_published_comes_again_byte_for_byte(recording: Path) -> None:
    samples = list(read_recording(recording))
    originals = of(samples, *OUTPUTS)
    # 5 Hz, give or take the epoch at either end.
    assert abs(len(of(samples, topics.GNSS_EPOCH)) - 5 * DRIVE_S) <= 1
    assert len(of(originals, topics.GNSS_FIX)) == len(of(samples, topics.GNSS_EPOCH))
    assert replay_through(samples, [CORRECTION]) == originals


def test_two_replays_in_processes_that_hash_differently_give_identical_files(recording: Path, tmp_path: Path) -> None:
    results = []
    for seed in ("1", "2"):
        out = tmp_path / f"{seed}.mcap"
        command = [sys.executable, "-m", "services.cli", "replay", str(recording)]
        command += ["--through", "gnss_correction", "--out", str(out)]
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=False)
        assert done.returncode == 0, done.stderr
        results.append(out.read_bytes())
    assert results[0] == results[1]
    assert len(of(list(read_recording(tmp_path / "1.mcap")), topics.GNSS_FIX)) >= 5 * DRIVE_S - 1
