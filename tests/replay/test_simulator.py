"""The simulator service on a virtual bus and clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schemas.codec import encode
from schemas.gnss import Ephemeris, Epoch, Ionosphere
from schemas.gnss_time import NS, gps_from_unix_ns, unix_ns_from_gps
from schemas.message import Message
from schemas.position import TrainTruth
from schemas.topic import Place
from schemas.topics import GNSS_EPHEMERIS, GNSS_EPOCH, GNSS_IONOSPHERE, TRAIN_TRUTH
from services.runtime.guest import guest
from services.runtime.manual_loop import ManualLoop, manual_loop
from services.runtime.node import Arrival
from services.simulator.scenario_file import read_scenario
from services.simulator.service import SERVICE, Config
from services.simulator.simulation import Simulation
from tests.replay.service_stage import ServiceStage

START_NS = unix_ns_from_gps(2412, 190_799.93)
PLACE = Place("demo", "train", "T1")
LISTENER = guest("listener", "listens", reads=(GNSS_EPOCH, GNSS_EPHEMERIS, GNSS_IONOSPHERE, TRAIN_TRUTH))


class Stage(ServiceStage[Config]):
    """The simulator of an antenna, and everything it has published."""

    def __init__(self, loop: ManualLoop, config: Config) -> None:
        self.device = config.device
        super().__init__(loop, SERVICE, config, outside=LISTENER, place=PLACE, start_ns=START_NS)

    def hear(self, arrival: Arrival[Message]) -> None:
        assert arrival.fields["device"] == self.device
        super().hear(arrival)

    def of(self, kind: type[Message]) -> list[Message]:
        return [message for message in self.heard if type(message) is kind]

    def epochs(self) -> list[Epoch]:
        return [message for message in self.heard if isinstance(message, Epoch)]


def test_it_plays_live_from_now_on() -> None:
    with manual_loop() as loop:
        stage = Stage(loop, Config())
        assert stage.node.is_ready.is_set()
        assert stage.heard == []
        loop.advance(10.0)
        epochs, truths = stage.epochs(), stage.of(TrainTruth)
        # The first whole fifth of a second after the start is 70 ms away.
        assert [round(e.tow_s, 3) for e in epochs[:3]] == [190_800.0, 190_800.2, 190_800.4]
        assert len(epochs) == len(truths) == 50
        assert stage.clock.now_ns() - epochs[-1].t_ns < 0.2 * NS
        # Orbits and ionosphere come before the first epoch, and hold now.
        first = stage.heard.index(epochs[0])
        assert isinstance(stage.heard[0], Ionosphere)
        ephemerides = [message for message in stage.heard[:first] if isinstance(message, Ephemeris)]
        assert len(ephemerides) == 31
        assert {s for e in epochs for s in e.satellites} <= {e.satellite for e in ephemerides}
        for ephemeris in ephemerides:
            assert abs(ephemeris.toe_s - epochs[0].tow_s) <= ephemeris.fit_interval_s / 2


def test_what_it_publishes_is_what_the_simulation_gives() -> None:
    with manual_loop() as loop:
        stage = Stage(loop, Config(seed=5, device="rear"))
        loop.advance(5.0)
        week, tow_s = gps_from_unix_ns(START_NS)
        start_ns = week * 604_800 * NS + -(-round(tow_s * NS) // 200_000_000) * 200_000_000
        alike = Simulation(read_scenario("street_canyon"), start_ns, np.random.default_rng(5))
        for epoch in stage.epochs():
            assert encode(epoch) == encode(alike.step().epoch)


def test_faster_than_time_the_same_epochs_come_sooner() -> None:
    with manual_loop() as loop:
        slow, fast = Stage(loop, Config()), Stage(loop, Config(speed=10.0))
        loop.advance(5.0)
        assert len(fast.epochs()) == 250
        assert [encode(e) for e in fast.epochs()[:25]] == [encode(e) for e in slow.epochs()[:25]]


def test_new_ephemerides_follow_every_two_hours(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "services/simulator/scenarios/street_canyon.toml").read_text("utf-8")
    (tmp_path / "slow.toml").write_text(f"{text}\n[receiver]\ninterval_s = 30.0\n", "utf-8")
    with manual_loop() as loop:
        stage = Stage(loop, Config(scenario=str(tmp_path / "slow.toml"), speed=100.0))
        # 05:00 until 07:05: the change of reference time from 06:00 to 08:00 is at 07:00.
        loop.advance(75.0)
        references = [message.toe_s for message in stage.of(Ephemeris) if isinstance(message, Ephemeris)]
        assert references == [194_400.0] * 31 + [201_600.0] * 31


def test_epochs_missed_while_the_host_slept_are_left_out() -> None:
    with manual_loop() as loop:
        stage = Stage(loop, Config())
        loop.advance(1.0)
        # Virtual time passes without the loop running: what a suspended host looks like.
        loop._now_s += 60.0
        loop.advance(1.0)
        times = np.array([epoch.tow_s for epoch in stage.epochs()])
        assert np.sort(np.diff(times))[-2:].round(1).tolist() == [0.2, 60.2]
        assert stage.node.health.counts["epochs_skipped"] == 300
        assert stage.clock.now_ns() - stage.epochs()[-1].t_ns < 0.2 * NS


def test_a_step_of_the_hosts_calendar_does_not_move_gps_time() -> None:
    with manual_loop() as loop:
        stage = Stage(loop, Config())
        loop.advance(1.0)
        stage.clock.step(-3600 * NS)
        loop.advance(1.0)
        assert np.diff([epoch.tow_s for epoch in stage.epochs()]).round(6).tolist() == [0.2] * 9


def test_it_stops_when_asked_to() -> None:
    with manual_loop() as loop:
        stage = Stage(loop, Config())
        loop.advance(1.0)
        stage.node.stop()
        loop.settle()
        assert stage.task.done()
        assert stage.task.exception() is None


def test_a_wrong_scenario_ends_it_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text("name = 1\n", "utf-8")
    with manual_loop() as loop:
        stage = Stage(loop, Config(scenario=str(tmp_path / "bad.toml")))
        errors = stage.task.exception()
        assert isinstance(errors, ExceptionGroup) or errors is not None
        assert "bad.toml" in str(errors.exceptions if isinstance(errors, ExceptionGroup) else errors)
