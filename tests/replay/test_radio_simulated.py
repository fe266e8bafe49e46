"""Simulated radios on a virtual bus and clock: on a train, in time-lapse, beside the line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from schemas.codec import encode
from schemas.gnss_time import NS, unix_ns_from_gps
from schemas.position import FaultKind, MotionTruth, SimulatorFault, TrainPosition
from schemas.radio import RadioMeasurement, Weather
from schemas.topic import Place
from schemas.topics import (
    MOTION_TRUTH,
    RADIO_MEASUREMENT,
    RADIO_READING,
    SIMULATOR_FAULT,
    TRAIN_POSITION,
    WEATHER,
)
from services.radio_probe.service import SERVICE as PROBE
from services.radio_probe.settings import Config as ProbeConfig
from services.runtime.guest import guest
from services.runtime.manual_loop import ManualLoop, manual_loop
from services.runtime.memory_node import MemoryNode
from services.simulator.radio_wayside_file import WaysideRadioSettings
from services.simulator.service import SERVICE, Config
from tests.replay.service_stage import ServiceStage

START_NS = unix_ns_from_gps(2412, 190_799.93)
TRAIN = Place("demo", "train", "T1")
DRY = """
name = "dry"
line = "demo"
seed = 4
[journey]
start_axis_m = 250.0
[driving]
dwell_s = [2.0, 2.0]
[radio]
"""
LAPSE = """
name = "lapse"
[straight]
[radio]
period_s = 8.0
reach_m = 900.0
[passes]
days = 3
per_day = 1
[[faults]]
kind = "radio_dead"
from_day = 1.0
to_day = 2.0
radio = "R03"
"""


OUTSIDE = guest("outside", "speaks and listens", reads=(RADIO_READING, WEATHER), writes=(SIMULATOR_FAULT, MOTION_TRUTH))


class Stage(ServiceStage[Config]):
    """The simulator of a place, and what its radio says."""

    def __init__(self, loop: ManualLoop, place: Place, config: Config) -> None:
        super().__init__(loop, SERVICE, config, outside=OUTSIDE, place=place, start_ns=START_NS)
        self.train = MemoryNode(self.bus, OUTSIDE, TRAIN, self.clock)

    def fault(self, kind: FaultKind, **fields: Any) -> None:  # noqa: ANN401 - any field
        message = SimulatorFault(t_ns=self.clock.now_ns(), kind=kind, **fields)
        self.say(self.train, SIMULATOR_FAULT, message)

    def readings(self, radio: str = "") -> list[RadioMeasurement]:
        return [one for one in self.heard if isinstance(one, RadioMeasurement) and (not radio or one.radio == radio)]


def scenario(folder: Path, text: str) -> str:
    path = folder / "scenario.toml"
    path.write_text(text, "utf-8")
    return str(path)


def test_a_train_s_radio_speaks_twice_a_second_without_its_place(tmp_path: Path) -> None:
    with manual_loop() as loop:
        stage = Stage(loop, TRAIN, Config(scenario=scenario(tmp_path, DRY)))
        loop.advance(10.0)
        near = stage.readings("R01")
        assert len(near) in (19, 20)
        assert {one.t_ns % (NS // 2) for one in near} == {0}
        # From 250 m on radios at 1000 m and 2500 m off it are within reach; the third stands at 5000 m.
        assert {one.radio for one in stage.readings()} == {"R01"}
        assert all(one.axis_m is None and one.direction is None and one.pass_id == "" for one in near)
        weather = [one for one in stage.heard if isinstance(one, Weather)]
        assert [one.axis_m for one in weather] == [2565.0, 7696.0, 12826.0, 17957.0, 23088.0]
        stage.end()


def test_radio_faults_are_switched_live(tmp_path: Path) -> None:
    with manual_loop() as loop:
        stage = Stage(loop, TRAIN, Config(scenario=scenario(tmp_path, DRY)))
        loop.advance(5.0)
        stage.fault("radio_dead", radio="R01")
        mark = len(stage.heard)
        loop.advance(3.0)
        assert {one.received_ratio for one in stage.readings("R01")[-5:]} == {0.0}
        assert stage.readings("R01")[-1].decoded_power_dbm is None
        assert "fault_radio_dead" in stage.node.health._reasons
        stage.fault("radio_dead", active=False)
        loop.advance(1.0)
        assert stage.readings("R01")[-1].received_ratio == 1.0
        stage.fault("radio_dead")
        loop.advance(1.0)
        mark = len(stage.readings())
        loop.advance(3.0)
        assert len(stage.readings()) == mark
        stage.fault("radio_snow", start_axis_m=0.0, end_axis_m=6000.0, duration_s=100.0)
        loop.advance(60.0)
        told = {one.axis_m: one for one in stage.heard if isinstance(one, Weather)}
        assert [bool(one.snow_mm_per_h) for one in told.values()][:2] == [True, False]
        stage.end()


def test_time_lapse_takes_pass_after_pass_with_its_place(tmp_path: Path) -> None:
    def once() -> list[bytes]:
        with manual_loop() as loop:
            stage = Stage(loop, TRAIN, Config(scenario=scenario(tmp_path, LAPSE), lapse_speed=400.0))
            loop.advance(60.0)
            passes = {one.pass_id: one.direction for one in stage.readings()}
            assert len(passes) == 3
            assert list(passes.values()) == ["up"] * 3
            assert all(name.startswith("T1-") for name in passes)
            newest = max(one.t_ns for one in stage.readings())
            assert 0 < START_NS - newest < 2 * 86_400 * NS
            third = [one for one in stage.readings("R03") if one.received_ratio == 0.0]
            assert {one.pass_id for one in third} == {list(passes)[1]}
            assert stage.node.health.counts["passes"] == 3
            stage.end()
            return [encode(one) for one in stage.heard]

    first = once()
    assert len(first) > 100
    assert once() == first


def test_a_wayside_radio_hears_the_trains_that_pass() -> None:
    with manual_loop() as loop:
        settings = WaysideRadioSettings(site="R02")
        stage = Stage(loop, Place("demo", "wayside", "R02"), Config(wayside_radio=settings))
        for tick in range(200):
            axis_m = 200.0 + 2.0 * tick * 10
            truth = MotionTruth(
                t_ns=START_NS + tick * NS // 10, axis_m=axis_m, chainage_m=axis_m, distance_m=axis_m, speed_mps=20.0,
                acceleration_mps2=0.0, slip=0, gradient_permille=0.0, curvature_per_m=0.0,
            )  # fmt: skip
            loop.create_task(stage.train.publish(MOTION_TRUTH, msgspec.structs.replace(truth)))
            loop.advance(0.1)
        got = stage.readings()
        assert {(one.radio, one.train, one.side) for one in got} == {("R02", "T1", "wayside")}
        # The site stands at 3000 m and hears 2500 m far: from 500 m on, twice a second.
        assert len(got) == len({one.t_ns for one in got})
        assert 34 <= len(got) <= 38
        best = max(got, key=lambda one: one.channel_power_dbm or -999.0)
        assert abs((best.t_ns - START_NS) / NS - 14.0) < 3.0
        stage.end()


def test_measurements_are_placed_where_the_simulated_train_was(tmp_path: Path) -> None:
    with manual_loop() as loop:
        stage = Stage(loop, TRAIN, Config(scenario=scenario(tmp_path, DRY)))
        ears = guest(
            "ears", "listens, and is the train", reads=(MOTION_TRUTH, RADIO_MEASUREMENT), writes=(TRAIN_POSITION,)
        )
        node = MemoryNode(stage.bus, ears, TRAIN, stage.clock)
        probe = MemoryNode(stage.bus, PROBE, TRAIN, stage.clock)
        truths: list[MotionTruth] = []
        placed: list[RadioMeasurement] = []

        async def position() -> None:
            async for truth in node.messages(MOTION_TRUTH):
                truths.append(truth)
                told = TrainPosition(
                    t_ns=truth.t_ns, status="valid", reason="", branch="", axis_m=truth.axis_m,
                    chainage_m=truth.chainage_m, direction="up", speed_mps=truth.speed_mps, bound_ahead_m=1.0,
                    bound_behind_m=1.0,
                )  # fmt: skip
                await node.publish(TRAIN_POSITION, told)

        async def listen() -> None:
            async for one in node.messages(RADIO_MEASUREMENT):
                placed.extend((one,))

        tasks = [loop.create_task(work) for work in (position(), listen(), probe.run(ProbeConfig()))]
        loop.advance(60.0)
        there = {truth.t_ns: truth for truth in truths}
        assert len(placed) > 100
        for one in placed[4:]:
            truth = there[one.t_ns]
            # Rounded to centimetres; readings are at ends of ticks, for which a position is told.
            assert abs((one.axis_m or 0.0) - truth.axis_m) < 0.006
            assert abs((one.chainage_m or 0.0) - truth.chainage_m) < 0.006
        assert len({one.pass_id for one in placed[4:]}) == 1
        assert placed[-1].axis_m is not None
        assert placed[-1].axis_m > 600.0
        for part in (node, probe):
            part.stop()
        stage.end()
        assert all(task.done() for task in tasks)
