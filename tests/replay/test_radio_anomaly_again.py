"""The radio's watch killed and started again, while the bus says again what it has heard before."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest

from schemas.codec import decode
from schemas.radio import RadioEvent
from schemas.topic import Delivery, mirrored_key
from schemas.topics import RADIO_EVENT, RADIO_MEASUREMENT, topic_of
from services.radio_anomaly.file_analysis import learn
from services.radio_anomaly.radio_model import RadioModel
from services.radio_anomaly.radio_model_file import read_model, write_model
from services.radio_anomaly.reading import Reading
from services.radio_anomaly.service import SERVICE, TICK_S, Config
from services.radio_anomaly.settings import Settings
from services.runtime.clock import ManualClock
from services.runtime.manual_loop import ManualLoop, manual_loop
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Sample
from tests.replay.test_radio_anomaly import TRAIN, message_of, sample
from tests.unit.radio_anomaly.made_up import DAY_NS, at, one_pass

LEARNED = 24
STRETCH = (15, 25)


@pytest.fixture(scope="module")
def model_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("radio") / "model.json"
    history = [one for n in range(LEARNED) for one in one_pass(n)]
    write_model(path, learn(history, Settings(), "line", "made up", Counter()))
    return path


class Line:
    """A bus that says again what was said, a watch on it, and what it tells."""

    def __init__(self, loop: ManualLoop, config: Config) -> None:
        self.told: list[RadioEvent] = []
        self._loop, self._config = loop, config
        self._clock = ManualClock(loop, one_pass(LEARNED)[0].t_ns)
        self._bus = MemoryBus(on_publish=self._hear)
        self.start()

    def _hear(self, published: Sample) -> None:
        address = topic_of(published.key)
        if address is not None and address.topic is RADIO_EVENT:
            self.told.append(decode(RadioEvent, published.payload))

    def start(self) -> None:
        self.node = MemoryNode(self._bus, SERVICE, TRAIN, self._clock)
        self._task = self._loop.create_task(self._watch())
        self._loop.settle()

    async def _watch(self) -> None:
        await SERVICE.run(self.node, self._config)

    def say(self, samples: Sequence[Sample]) -> None:
        for one in samples:
            self._bus.put(one, Delivery.KEPT)
            self._loop.settle()

    def tick(self) -> None:
        self._loop.advance(TICK_S)

    def kill(self) -> None:
        """Nothing is finished and nothing is written any more."""
        self._task.cancel()
        self._loop.settle()

    def stop(self) -> None:
        self.node.stop()
        self._loop.settle()
        assert self._task.done()


def kept(folder: Path) -> RadioModel:
    (path,) = folder.rglob("*.json")
    return read_model(path)


def samples_of(readings: Sequence[Reading], device: str = "cab", begin: int = 0) -> list[Sample]:
    return [sample(RADIO_MEASUREMENT, message_of(r), begin + n, device=device) for n, r in enumerate(readings)]


def faulty(number: int) -> list[Reading]:
    return one_pass(number, change_db=-12.0, stretch=STRETCH)


def in_turn(device_by_device: Sequence[Sequence[Sample]]) -> list[Sample]:
    return [one for each in zip(*device_by_device, strict=True) for one in each]


def watched(config: Config, *parts: Sequence[Sample]) -> Line:
    """Told of a watch that is killed between one part and the next, once what it has learned is written."""
    with manual_loop() as loop:
        line = Line(loop, config)
        for part in parts[:-1]:
            line.say(part)
            line.tick()
            line.kill()
            line.start()
        line.say(parts[-1])
        line.stop()
    return line


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("devices", [("cab",), ("cab", "tail")])
def test_what_the_bus_says_again_is_neither_learned_nor_told_again(
    model_file: Path, tmp_path: Path, devices: tuple[str, ...], *, mirrored: bool
) -> None:
    readings = [one for n in range(LEARNED, LEARNED + 4) for one in faulty(n)]
    tape = in_turn([samples_of(readings, device) for device in devices])
    if mirrored:
        tape = [msgspec.structs.replace(one, key=mirrored_key(one.key)) for one in tape]
    # In the middle of the second pass, and of the third: both are heard again from their beginning.
    per_pass = len(tape) // 4
    cuts = (per_pass * 3 // 2, per_pass * 5 // 2)
    lines, models = [], []
    for name, parts in {
        "whole": (tape,),
        "killed": (tape[: cuts[0]], tape[cuts[0] : cuts[1]], tape[cuts[1] :]),
    }.items():
        folder = tmp_path / name
        config = Config(model_file=str(model_file), state_folder=str(folder), save_s=1.0, mirrored=mirrored)
        lines.append(watched(config, *parts))
        models.append(kept(folder))
    assert lines[1].told == lines[0].told
    assert models[1] == models[0]
    assert {one.passes for one in models[0].streams} == {LEARNED + 2.0 * len(devices)}, "two days of two, one over"
    assert lines[1].node.health.counts["said_again"] == 2 * per_pass
    assert "said_again" not in lines[0].node.health.counts


def test_a_pass_of_a_clock_that_was_set_back_is_new(model_file: Path, tmp_path: Path) -> None:
    earlier = [at(one, t_ns=one.t_ns - 300 * DAY_NS) for one in faulty(LEARNED + 1)]
    first = faulty(LEARNED)
    config = Config(model_file=str(model_file), state_folder=str(tmp_path), save_s=1.0)
    ended = [at(one, pass_id="next") for one in one_pass(LEARNED + 2)[:3]]
    tape = samples_of([*first, *ended, *earlier])
    line = watched(config, tape[: len(first) + len(ended)], tape[len(first) + len(ended) :])
    assert line.node.health.counts["said_again"] == len(first)
    assert line.node.health.counts["passes"] == 2, "the one that was under way, and the one stamped earlier"
    assert earlier[0].pass_id in {one.pass_id for one in line.told}


def test_a_sender_that_numbers_anew_is_heard_and_named(model_file: Path, tmp_path: Path) -> None:
    config = Config(model_file=str(model_file), state_folder=str(tmp_path))
    passes = faulty(LEARNED), faulty(LEARNED + 1)
    watched(config, samples_of(passes[0]))
    line = watched(config, samples_of(passes[1]))
    counts = line.node.health.counts
    assert (counts["passes"], counts["renumbered"]) == (1, len(passes[1]))
    assert any("numbers that were had" in one for one in line.node.health.level(line.node.clock.monotonic_s())[1])
    assert "said_again" not in counts
