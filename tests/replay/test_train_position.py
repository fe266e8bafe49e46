"""The position's service: a recorded run through it, its restart, its silence."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from schemas.codec import decode, encode
from schemas.line import Line
from schemas.message import Message
from schemas.position import PositionEvent, ReferencePass, TrainChange, TrainPosition
from schemas.topic import Place, Topic
from schemas.topics import (
    GNSS_FRONT_END,
    LANDMARK_MATCH,
    ODOMETRY,
    POSITION_EVENT,
    REFERENCE_PASS,
    TRAIN_CHANGE,
    TRAIN_POSITION,
    topic_of,
)
from services.recorder.offline_replay import replay_through
from services.runtime.attachment import Attachment, encode_attachment
from services.runtime.node import Sample
from services.train_position.position_store import read_snapshot, state_file
from services.train_position.service import SERVICE
from services.train_position.settings import Config
from tests.unit.train_position.made_up import Run, run_with, straight_line

TRAIN = Place("made-up", "train", "T1")


class Tape:
    """A run's messages as recorded samples."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.samples: list[Sample] = []

    def put(self, topic: Topic[Message], message: Message, later_s: float = 0.0) -> None:
        sent_ns = self.run.t_ns + round(later_s * 1e9)
        attachment = encode_attachment(Attachment("tape", "boot", len(self.samples), sent_ns))
        self.samples.append(Sample(topic.at(TRAIN), encode(message), attachment, sent_ns))

    def go(self, seconds: float, acceleration_mps2: float = 0.0) -> None:
        for _ in range(round(seconds * 10)):
            self.run.go(0.1, acceleration_mps2, silent=True)
            self.put(ODOMETRY, self.run.odometry(), 0.05)

    def ordered(self) -> list[Sample]:
        return sorted(self.samples, key=lambda one: one.received_ns)


def drive() -> Tape:
    tape = Tape(run_with(wheel_error=0.01))
    run = tape.run
    tape.go(10.0, 1.0)
    for number in range(4):
        tape.put(GNSS_FRONT_END, run.front_end(1.0, 8.0), 0.4)
        tape.go(10.0)
        tape.put(LANDMARK_MATCH, run.landmark(f"C{number}", -1.0, 4.0), 3.0)
        tape.go(5.0)
    return tape


@pytest.fixture
def config(tmp_path: Path) -> Config:
    path = tmp_path / "line.json"
    path.write_bytes(msgspec.json.encode(straight_line()))
    return Config(line_file=str(path))


def heard(samples: list[Sample], config: Config, topic: Topic[Message]) -> list[Message]:
    said = replay_through(samples, [SERVICE], {"train_position": config})
    found = [(topic_of(sample.key), sample) for sample in said]
    return [decode(topic.message, one.payload) for address, one in found if address and address.topic is topic]


def test_every_message_of_the_odometry_gets_a_position(config: Config) -> None:
    tape = drive()
    positions = heard(tape.ordered(), config, TRAIN_POSITION)
    count = sum("odometry" in one.key for one in tape.samples)
    assert len(positions) == count
    last = positions[-1]
    assert isinstance(last, TrainPosition)
    assert last.status == "valid"
    assert last.axis_m is not None
    assert last.bound_behind_m is not None
    assert -last.bound_behind_m <= tape.run.front_m - last.axis_m <= (last.bound_ahead_m or 0.0)
    assert last.line_version == "1"


def test_passes_and_events_are_published(config: Config) -> None:
    samples = drive().ordered()
    passes = heard(samples, config, REFERENCE_PASS)
    assert [one.within for one in passes if isinstance(one, ReferencePass)] == [True] * 4
    kinds = [one.kind for one in heard(samples, config, POSITION_EVENT) if isinstance(one, PositionEvent)]
    assert "status" in kinds
    assert "reset" in kinds


def test_the_same_recording_gives_the_same_bytes(config: Config) -> None:
    samples = drive().ordered()
    first, second = (replay_through(samples, [SERVICE], {"train_position": config}) for _ in range(2))
    assert [(one.key, one.payload) for one in first] == [(one.key, one.payload) for one in second]


def test_a_silent_odometry_is_carried_on_by_physics(config: Config) -> None:
    tape = drive()
    tape.run.go(5.0, silent=True)
    tape.put(TRAIN_CHANGE, TrainChange(t_ns=tape.run.t_ns, kind="route", branch=""))
    positions = [one for one in heard(tape.ordered(), config, TRAIN_POSITION) if isinstance(one, TrainPosition)]
    count = sum("odometry" in one.key for one in tape.samples)
    assert len(positions) > count + 30
    assert "no odometry" in positions[-1].reason
    # Half of 1.5 m/s² over 5 s, to either side, at the least.
    assert (positions[-1].bound_ahead_m or 0.0) > 15.0


def test_odometry_that_was_held_up_is_carried_on_to_now(config: Config) -> None:
    tape = drive()
    for _ in range(20):
        tape.run.go(0.1, silent=True)
        tape.put(ODOMETRY, tape.run.odometry(), 5.05)
    positions = [one for one in heard(tape.ordered(), config, TRAIN_POSITION) if isinstance(one, TrainPosition)]
    assert positions[-1].status == "degraded"
    assert "5.0 s late" in positions[-1].reason
    # To the microsecond: clocks of floats.
    assert positions[-1].t_ns == pytest.approx(tape.run.t_ns + 5_000_000_000, abs=1000)


def test_the_state_survives_a_restart_of_the_service(config: Config, tmp_path: Path) -> None:
    kept = msgspec.structs.replace(config, state_folder=str(tmp_path))
    tape = drive()
    heard(tape.ordered(), kept, TRAIN_POSITION)
    path = state_file(tmp_path, TRAIN.line, TRAIN.name)
    snapshot = read_snapshot(path)
    assert snapshot is not None
    assert snapshot.axis_m is not None
    tape.samples.clear()
    tape.go(2.0)
    positions = [one for one in heard(tape.ordered(), kept, TRAIN_POSITION) if isinstance(one, TrainPosition)]
    assert {one.status for one in positions} == {"degraded"}
    assert "restarted" in positions[-1].reason
    path.write_bytes(b"{")
    tape.samples.clear()
    tape.go(1.0)
    lost = [one for one in heard(tape.ordered(), kept, TRAIN_POSITION) if isinstance(one, TrainPosition)]
    assert {one.status for one in lost} == {"lost"}


def test_a_replay_keeps_no_state_of_its_own(config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KIROTEI_STATE_DIR", str(tmp_path / "host"))
    heard(drive().ordered(), config, TRAIN_POSITION)
    assert not (tmp_path / "host").exists()


def test_the_line_is_one_that_the_schema_reads() -> None:
    assert msgspec.json.decode(msgspec.json.encode(straight_line()), type=Line) == straight_line()
