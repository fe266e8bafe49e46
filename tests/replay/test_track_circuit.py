"""The track-circuit service on a bus in memory, beside the line and on board, on simulated rail."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TypeVar

import msgspec

from schemas.message import Message
from schemas.position import TrainPosition
from schemas.topic import Place
from schemas.topics import (
    TRACK_CODE,
    TRACK_CONFIRMATION,
    TRACK_EQUALISER,
    TRACK_EVENT,
    TRACK_HEALTH,
    TRACK_OCCUPANCY,
    TRACK_SAMPLES,
    TRACK_TELEGRAM,
    TRAIN_POSITION,
)
from schemas.track_circuit import (
    CircuitEvent,
    CircuitHealth,
    CircuitOccupancy,
    ClearConfirmation,
    CodedCarrier,
    EqualiserState,
    Telegram,
)
from services.runtime.clock import ManualClock
from services.runtime.guest import guest
from services.runtime.manual_loop import run_manual
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.simulator.track_circuit_scene import SimulatedCircuit
from services.simulator.track_circuit_settings import Occupation, TrackCircuitSettings
from services.track_circuit.coefficients_store import read_store, store_path
from services.track_circuit.profile import Framing, Profile
from services.track_circuit.service import SERVICE
from services.track_circuit.settings import CircuitSettings, Config

START_NS = 1_795_305_600_000_000_000
WAYSIDE = Place("demo", "wayside", "W1")
TRAIN = Place("demo", "train", "T1")
M = TypeVar("M", bound=Message)


HEARD = (TRACK_TELEGRAM, TRACK_CODE, TRACK_EQUALISER, TRACK_OCCUPANCY, TRACK_HEALTH, TRACK_EVENT)
WRITER = guest("writer", "speaks", writes=(TRACK_SAMPLES, TRACK_CONFIRMATION, TRAIN_POSITION))
READER = guest("reader", "hears", reads=HEARD)


class Heard:
    """What the service said."""

    def __init__(self) -> None:
        self.messages: list[Message] = []
        self.counts: dict[str, int] = {}

    def of(self, kind: type[M]) -> list[M]:
        return [message for message in self.messages if isinstance(message, kind)]

    def events(self) -> list[str]:
        return [event.kind for event in self.of(CircuitEvent)]

    def at(self, seconds: float) -> CircuitOccupancy:
        return [one for one in self.of(CircuitOccupancy) if one.t_ns <= START_NS + round(seconds * 1e9)][-1]


def served(
    circuits: dict[str, SimulatedCircuit],
    config: Config,
    seconds: float,
    *,
    place: Place = WAYSIDE,
    confirm_s: float | None = None,
    positions: tuple[tuple[float, float], ...] = (),
) -> Heard:
    """Everything that the service says while simulated circuits run; `positions` are (time, axis_m)."""
    found = Heard()

    async def hear(node: MemoryNode) -> None:
        async for message in node.messages(*HEARD):
            found.messages.append(message)

    async def main() -> None:
        clock = ManualClock(asyncio.get_running_loop(), START_NS)
        bus = MemoryBus()
        writer, reader, node = (MemoryNode(bus, service, place, clock) for service in (WRITER, READER, SERVICE))
        listening = asyncio.ensure_future(hear(reader))
        running = asyncio.ensure_future(node.run(config))
        await node.is_ready.wait()
        confirmed, standing = confirm_s is None, list(positions)
        step = 0
        while step * 0.1 < seconds:
            step += 1
            now_s = step * 0.1
            await asyncio.sleep(max(0.0, now_s - clock.monotonic_s()))
            if standing and now_s >= standing[0][0]:
                await writer.publish(TRAIN_POSITION, _position(clock.now_ns(), standing.pop(0)[1]))
            for name, circuit in circuits.items():
                if (block := circuit.step(START_NS)) is not None:
                    await writer.publish(TRACK_SAMPLES, block, circuit=name)
            if not confirmed and confirm_s is not None and now_s >= confirm_s:
                confirmed = True
                word = ClearConfirmation(t_ns=clock.now_ns(), circuit="TC1", by="test")
                await writer.publish(TRACK_CONFIRMATION, word, circuit="TC1")
        node.stop()
        await running
        found.counts = dict(node.health.counts)
        reader.stop()
        await listening

    run_manual(main())
    return found


def _position(t_ns: int, axis_m: float) -> TrainPosition:
    return TrainPosition(t_ns=t_ns, status="valid", reason="", branch="", axis_m=axis_m)


def circuit_of(**changes: object) -> CircuitSettings:
    return msgspec.structs.replace(CircuitSettings(name="TC1", circuit_id=1, length_m=1000.0), **changes)


def test_a_train_is_seen_and_the_circuit_clears_after_it(tmp_path: Path) -> None:
    scene = SimulatedCircuit(TrackCircuitSettings(trains=(Occupation(enter_s=8.0, leave_s=11.0),)))
    config = Config(circuits=(circuit_of(),), state_folder=str(tmp_path))
    heard = served({"TC1": scene, "stranger": SimulatedCircuit(TrackCircuitSettings())}, config, 15.5, confirm_s=2.0)
    assert (heard.at(1.9).state, heard.at(1.9).reason) == ("occupied", "the clear circuit's level is not known")
    assert heard.at(7.9).state == "clear"
    # A burst of symbols, its successor and the drop's delay: under a second.
    assert heard.at(9.0).state == "occupied"
    assert heard.at(11.0).state == "occupied"
    assert heard.at(15.4).state == "clear"
    assert [kind for kind in heard.events() if kind in ("occupied", "cleared")] == ["cleared", "occupied", "cleared"]
    good = [one for one in heard.of(Telegram) if one.state == "good"]
    assert {(one.circuit_id, one.payload) for one in good} == {(1, b"\xa5\x5a")}
    assert len(good) > 25
    assert heard.of(EqualiserState)[-1].taps.size > 0
    assert heard.of(CircuitHealth)[-1].telegrams > 20
    assert heard.counts["unknown_circuits"] >= 150
    # What was learned while clear is kept for the next start.
    kept = read_store(store_path(tmp_path)).sets
    assert [(one.circuit, one.receiver) for one in kept] == [("TC1", "mlse")]


def test_a_restart_at_once_takes_up_the_level_and_a_late_one_does_not(tmp_path: Path) -> None:
    config = Config(circuits=(circuit_of(),), state_folder=str(tmp_path))
    served({"TC1": SimulatedCircuit(TrackCircuitSettings())}, config, 5.5, confirm_s=1.5)
    file = next((tmp_path / "track_circuit").glob("references-*.json"))
    level_db = msgspec.json.decode(file.read_bytes())["TC1"]["level_db"]
    for age_s, state in ((60.0, "clear"), (3600.0, "occupied")):
        word = {"TC1": {"level_db": level_db, "t_ns": START_NS - round(age_s * 1e9)}}
        file.write_bytes(msgspec.json.encode(word))
        heard = served({"TC1": SimulatedCircuit(TrackCircuitSettings())}, config, 4.5)
        assert heard.at(4.4).state == state, age_s


def test_a_coded_circuit_is_decoded_and_watched() -> None:
    profile = Profile(scheme="fsk", carriers_hz=(2300.0,))
    settings = TrackCircuitSettings(
        profile=profile,
        carrier_offset_hz=1.4,
        code_hz=13.6,
        sample_rate_hz=8000.0,
        trains=(Occupation(enter_s=14.0, leave_s=18.0),),
        sending=3.0,
    )
    settings = msgspec.structs.replace(settings, rail=msgspec.structs.replace(settings.rail, tuned_q=0.0))
    config = Config(circuits=(circuit_of(profile=profile),))
    heard = served({"TC1": SimulatedCircuit(settings)}, config, 17.0, confirm_s=5.0)
    good = [one for one in heard.of(CodedCarrier) if one.state == "good"]
    assert {one.code_hz for one in good} == {13.6}
    # Windows across the train's entry have a step in them: some tenths of a hertz.
    assert all(one.carrier_hz is not None and abs(one.carrier_hz - 2301.4) < 0.4 for one in good)
    assert heard.at(13.9).state == "clear"
    assert heard.at(15.0).state == "occupied"


def test_on_board_nothing_is_said_of_occupancy_and_stretches_learn(tmp_path: Path) -> None:
    settings = circuit_of(sending_axis_m=1000.0)
    config = Config(circuits=(settings,), state_folder=str(tmp_path))
    scene = SimulatedCircuit(TrackCircuitSettings(sending=100.0))
    heard = served({"aerial": scene}, config, 8.0, place=TRAIN, positions=((0.5, 1150.0), (5.0, 1160.0), (7.0, 1250.0)))
    assert heard.of(CircuitOccupancy) == []
    assert any(one.state == "good" for one in heard.of(Telegram))
    bins = [one.distance_bin_m for one in read_store(store_path(tmp_path)).sets]
    assert (100.0, 200.0) in bins


def test_the_same_samples_give_the_same_words() -> None:
    config = Config(circuits=(circuit_of(profile=Profile(framing=Framing())),))
    first, second = (
        served({"TC1": SimulatedCircuit(TrackCircuitSettings())}, config, 3.0).of(Telegram) for _ in range(2)
    )
    assert first == second
    assert len(first) > 3
