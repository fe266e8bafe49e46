"""The landmark matching service on a bus in memory: matches, evidence, refusals in health, the same bytes each time."""

from __future__ import annotations

import asyncio
from pathlib import Path

from schemas.codec import decode, encode
from schemas.line import LandmarkDatabase
from schemas.motion import Odometry
from schemas.position import LandmarkMatch
from schemas.topic import Place
from schemas.topics import LANDMARK_MATCH, ODOMETRY, TRAIN_POSITION, topic_of
from services.landmark_matching.landmarks_file import write_landmarks
from services.landmark_matching.service import SERVICE, Config
from services.recorder.offline_replay import replay_through
from services.runtime.clock import ManualClock
from services.runtime.guest import guest
from services.runtime.manual_loop import run_manual
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Sample
from tests.unit.landmark_matching.demo_runs import demo_landmarks, demo_run, true_axis
from tests.unit.landmark_matching.live_messages import T0_NS, both_of, position_of

TRAIN = Place("demo", "train", "T1")
WRITER = guest("writer", "speaks", writes=(TRAIN_POSITION,))


def recorded() -> list[Sample]:
    readings, axis_m = demo_run("up", 900.0, 2400.0)
    samples = []
    for message in both_of(readings, axis_m.tolist(), "up"):
        topic = ODOMETRY if isinstance(message, Odometry) else TRAIN_POSITION
        key = topic.at(TRAIN)
        samples.append(Sample(key, encode(message), b"", message.t_ns))
    return samples


def test_a_recording_gives_the_same_matches_byte_for_byte() -> None:
    samples = recorded()
    first = replay_through(samples, [SERVICE], {"landmark_matching": Config()})
    matches = [sample for sample in first if (address := topic_of(sample.key)) and address.topic is LANDMARK_MATCH]
    _, axis_m = demo_run("up", 900.0, 2400.0)
    assert len(matches) == 2
    for sample in matches:
        match = decode(LandmarkMatch, sample.payload)
        assert match.accepted
        assert abs(match.axis_m - true_axis((match.t_ns - T0_NS) / 1e9, axis_m)) <= match.bound_m
    again = replay_through(samples, [SERVICE], {"landmark_matching": Config()})
    told = [
        (sample.key, sample.payload) for sample in again if "/landmark" in sample.key and "health" not in sample.key
    ]
    assert told == [(sample.key, sample.payload) for sample in matches]


def reasons_with(config: Config, *, line_version: str | None) -> tuple[str, ...]:
    """What health says after one position held on a version of the line."""
    readings, axis_m = demo_run("up", 900.0, 950.0)
    said: list[tuple[str, ...]] = []

    async def main() -> None:
        clock = ManualClock(asyncio.get_running_loop(), T0_NS)
        bus = MemoryBus()
        writer, node = MemoryNode(bus, WRITER, TRAIN, clock), MemoryNode(bus, SERVICE, TRAIN, clock)
        running = asyncio.ensure_future(node.run(config))
        await node.is_ready.wait()
        if line_version is not None:
            position = position_of(readings[0], float(axis_m[0]), "up", line_version=line_version)
            await writer.publish(TRAIN_POSITION, position)
        await asyncio.sleep(0.5)
        said.append(node.health.level(clock.monotonic_s())[1])
        node.stop()
        await running

    run_manual(main())
    return said[0]


def test_health_tells_of_another_version_of_the_line() -> None:
    assert reasons_with(Config(), line_version="2026-1") == ()
    (reason,) = reasons_with(Config(), line_version="2025-9")
    assert "2025-9" in reason


def test_a_database_of_another_version_is_refused_in_health(tmp_path: Path) -> None:
    path = tmp_path / "landmarks.json"
    known = demo_landmarks()
    one = known.landmarks[""][:1]
    write_landmarks(
        path, LandmarkDatabase(version="v", line=known.line, line_version="2025-9", origin="", landmarks=one)
    )
    (reason,) = reasons_with(Config(landmarks_file=str(path)), line_version=None)
    assert reason.startswith("landmarks refused: ")
