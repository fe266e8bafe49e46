"""The demo of the wet ballast in virtual time: telegrams lost when it gets wet, and won back."""

from __future__ import annotations

import asyncio
import tomllib
from pathlib import Path

import msgspec
import pytest

from schemas.topic import Place
from schemas.topics import TRACK_CONFIRMATION, TRACK_EVENT, TRACK_OCCUPANCY
from schemas.track_circuit import CircuitEvent, CircuitOccupancy, ClearConfirmation, Telegram
from services.runtime.clock import ManualClock
from services.runtime.guest import guest
from services.runtime.manual_loop import run_manual
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.simulator.service import SERVICE as SIMULATOR
from services.simulator.service import Config as SimulatorConfig
from services.simulator.track_circuit_scene import SimulatedCircuit
from services.simulator.track_circuit_settings import BallastPoint, Occupation, TrackCircuitSettings
from services.track_circuit.circuit_live import CircuitMessage, LiveCircuit
from services.track_circuit.code_table import CodeTable
from services.track_circuit.live_watch_command import ONLOOKER, NoSettings, log_circuits
from services.track_circuit.settings import Config

START_NS = 1_795_305_600_000_000_000
PROFILE = Path(__file__).parents[2] / "deploy" / "profiles" / "wet_ballast.toml"
WAYSIDE = Place("demo", "wayside", "W1")
SECONDS = 125.0


class Demo:
    """One circuit of the profile over its whole weather."""

    def __init__(self, name: str) -> None:
        table = tomllib.loads(PROFILE.read_text("utf-8"))
        rails = msgspec.convert(table["simulator"], SimulatorConfig).track_circuits
        circuits = msgspec.convert(table["track_circuit"], Config).circuits
        scene = SimulatedCircuit(next(one for one in rails if one.name == name))
        live = LiveCircuit(next(one for one in circuits if one.name == name), CodeTable(), on_board=False, now_s=0.0)
        self.said: list[CircuitMessage] = []
        confirmed = False
        while scene.next_s < SECONDS:
            block = scene.step(START_NS)
            now_s, now_ns = scene.next_s, START_NS + round(scene.next_s * 1e9)
            assert block is not None
            self.said += live.take(block, now_ns, now_s)
            if not confirmed and now_s >= 3.0:
                confirmed = True
                self.said += live.confirm(now_ns, now_ns, now_s)
            self.said += live.tick(now_ns, now_s)

    def good(self, begin_s: float, end_s: float) -> tuple[int, int]:
        """Telegrams that may be acted upon, and all, between two times."""
        found = [one for one in self.said if isinstance(one, Telegram)]
        inside = [one for one in found if begin_s <= (one.t_ns - START_NS) / 1e9 < end_s]
        return sum(one.state == "good" for one in inside), len(inside)

    def evm_db(self, begin_s: float, end_s: float) -> float:
        found = [one for one in self.said if isinstance(one, Telegram) and one.evm_db is not None]
        inside = [one.evm_db for one in found if begin_s <= (one.t_ns - START_NS) / 1e9 < end_s]
        return sum(one for one in inside if one is not None) / len(inside)

    def at(self, t_s: float) -> CircuitOccupancy:
        found = [one for one in self.said if isinstance(one, CircuitOccupancy)]
        return [one for one in found if one.t_ns <= START_NS + round(t_s * 1e9)][-1]

    def events(self, kind: str) -> list[float]:
        return [(one.t_ns - START_NS) / 1e9 for one in self.said if isinstance(one, CircuitEvent) and one.kind == kind]


@pytest.fixture(scope="module")
def default() -> Demo:
    return Demo("TC1")


@pytest.fixture(scope="module")
def paper() -> Demo:
    return Demo("TC1-LMS")


def test_telegrams_are_lost_when_the_ballast_is_soaked_and_won_back_when_it_dries(default: Demo) -> None:
    # Dry: every telegram of 181 bits at 300 bit/s is good.
    good, every = default.good(10.0, 30.0)
    assert good == every == 33
    assert default.at(29.0).state == "clear"
    # Soaked: the level is in the noise, the error great, no telegram good, the most restrictive aspect holds.
    assert default.good(88.0, 94.0)[0] == 0
    assert default.at(92.0).most_restrictive
    assert default.at(92.0).state == "occupied"
    lost, back = default.events("telegrams_lost"), default.events("telegrams_back")
    # Three seconds after the last good one; back while the level is still 9 dB low and occupied.
    assert [83.0 < t_s < 91.0 for t_s in lost] == [True]
    assert 95.0 < back[-1] < 106.0
    assert default.at(back[-1]).state == "occupied"
    assert default.good(106.0, 125.0)[0] > 28
    assert default.at(124.0).state == "clear"
    assert [30.0 < t_s < 55.0 for t_s in default.events("occupied")] == [True]
    assert len(default.events("cleared")) == 2


def test_on_the_wet_rail_the_default_receiver_keeps_what_the_papers_filter_loses(default: Demo, paper: Demo) -> None:
    assert paper.good(10.0, 30.0)[0] == 33
    ours, every = default.good(52.0, 79.0)
    theirs, _ = paper.good(52.0, 79.0)
    assert ours >= every - 2
    # Half of them; a quarter to three quarters leaves room for another noise.
    assert 0.2 * every < theirs < 0.75 * every
    assert [t_s for t_s in paper.events("telegrams_lost") if 50.0 < t_s < 80.0]
    assert not [t_s for t_s in default.events("telegrams_lost") if 50.0 < t_s < 80.0]
    assert paper.evm_db(52.0, 79.0) > default.evm_db(52.0, 79.0) + 2.0
    assert paper.evm_db(52.0, 79.0) > paper.evm_db(10.0, 30.0) + 5.0


def test_the_scene_knows_when_it_changes() -> None:
    rain = (
        BallastPoint(t_s=0.0, s_per_km=0.02),
        BallastPoint(t_s=9.0, s_per_km=0.02),
        BallastPoint(t_s=12.0, s_per_km=0.1),
    )
    assert SimulatedCircuit(TrackCircuitSettings(ballast=rain)).unchanged_until_s == 9.0
    train = Occupation(enter_s=7.0, leave_s=8.0)
    assert SimulatedCircuit(TrackCircuitSettings(ballast=rain, trains=(train,))).unchanged_until_s == 7.0
    assert SimulatedCircuit(TrackCircuitSettings()).unchanged_until_s == float("inf")


READER = guest("reader", "hears", reads=(TRACK_CONFIRMATION,))
TELLER = guest("teller", "speaks", writes=(TRACK_OCCUPANCY, TRACK_EVENT))


def test_a_simulated_circuit_is_confirmed_until_a_train_comes() -> None:
    heard: list[float] = []

    async def main() -> None:
        clock = ManualClock(asyncio.get_running_loop(), START_NS)
        bus = MemoryBus()
        reader, node = MemoryNode(bus, READER, WAYSIDE, clock), MemoryNode(bus, SIMULATOR, WAYSIDE, clock)

        async def hear() -> None:
            async for word in reader.messages(TRACK_CONFIRMATION):
                assert isinstance(word, ClearConfirmation)
                heard.append((word.t_ns - START_NS) / 1e9)

        listening = asyncio.ensure_future(hear())
        settings = TrackCircuitSettings(trains=(Occupation(enter_s=7.0, leave_s=8.0),))
        running = asyncio.ensure_future(node.run(SimulatorConfig(track_circuits=(settings,))))
        await asyncio.sleep(12.0)
        node.stop()
        await running
        reader.stop()
        await listening

    run_manual(main())
    # Told with the first block that begins then, which is a tenth of a second long.
    assert heard == pytest.approx([3.0, 6.0], abs=0.11)


def test_the_log_tells_events_at_once_and_circuits_now_and_then() -> None:
    lines: list[str] = []

    async def main() -> None:
        clock = ManualClock(asyncio.get_running_loop(), START_NS)
        bus = MemoryBus()
        teller = MemoryNode(bus, TELLER, WAYSIDE, clock)
        viewer = MemoryNode(bus, ONLOOKER, Place("demo", "cloud", "viewers"), clock)
        watching = asyncio.ensure_future(log_circuits(viewer, NoSettings(), lines.append))
        await asyncio.sleep(0.5)
        told = CircuitOccupancy(
            t_ns=START_NS, circuit="T1", state="occupied", reason="", most_restrictive=True, since_ns=START_NS
        )
        await teller.publish(TRACK_OCCUPANCY, told, circuit="T1")
        event = CircuitEvent(t_ns=START_NS, circuit="T1", kind="telegrams_lost", text="no good telegram in time")
        await teller.publish(TRACK_EVENT, event, circuit="T1")
        await asyncio.sleep(5.0)
        viewer.stop()
        await watching
        teller.stop()

    run_manual(main())
    assert "telegrams_lost" in lines[0]
    assert lines[1].startswith("T1         silent")
    assert len(lines) == 2
