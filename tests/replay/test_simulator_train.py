"""A whole simulated train on a virtual bus and clock, with faults switched live."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schemas.codec import encode
from schemas.gnss import Ephemeris, Epoch
from schemas.gnss_time import NS, unix_ns_from_gps
from schemas.message import Message
from schemas.motion import ImuBlock, TachoBlock
from schemas.position import BalisePassage, FaultKind, MotionTruth, SimulatorFault, TrainTruth
from schemas.topic import Place
from schemas.topics import (
    BALISE,
    GNSS_EPHEMERIS,
    GNSS_EPOCH,
    IMU,
    MOTION_TRUTH,
    SIMULATOR_FAULT,
    TACHO,
    TRAIN_CHANGE,
    TRAIN_TRUTH,
)
from services.runtime.guest import guest
from services.runtime.manual_loop import ManualLoop, manual_loop
from services.simulator.service import SERVICE, Config
from tests.replay.service_stage import ServiceStage

START_NS = unix_ns_from_gps(2412, 190_799.93)
PLACE = Place("demo", "train", "T1")
DRY = """
name = "dry"
line = "demo"
seed = 4
[journey]
start_axis_m = 250.0
[driving]
dwell_s = [2.0, 2.0]
"""
GNSS = DRY + "[gnss]\n"
OUTSIDE = guest(
    "outside",
    "speaks and listens",
    reads=(IMU, TACHO, BALISE, MOTION_TRUTH, TRAIN_CHANGE, GNSS_EPOCH, GNSS_EPHEMERIS, TRAIN_TRUTH),
    writes=(SIMULATOR_FAULT,),
)


class Stage(ServiceStage[Config]):
    """The simulator of a train, and everything it has published."""

    def __init__(self, loop: ManualLoop, folder: Path, text: str, **config: object) -> None:
        path = folder / "scenario.toml"
        path.write_text(text, "utf-8")
        settings = Config(scenario=str(path), **config)  # type: ignore[arg-type]  # any field
        super().__init__(loop, SERVICE, settings, outside=OUTSIDE, place=PLACE, start_ns=START_NS)

    def fault(
        self,
        kind: FaultKind,
        *,
        active: bool = True,
        magnitude: float | None = None,
        duration_s: float | None = None,
    ) -> None:
        now_ns = self.clock.now_ns()
        message = SimulatorFault(t_ns=now_ns, kind=kind, active=active, magnitude=magnitude, duration_s=duration_s)
        self.say(self.outside, SIMULATOR_FAULT, message)

    def imu(self) -> list[ImuBlock]:
        return [message for message in self.heard if isinstance(message, ImuBlock)]

    def tacho(self) -> list[TachoBlock]:
        return [message for message in self.heard if isinstance(message, TachoBlock)]

    def truth(self) -> list[MotionTruth]:
        return [message for message in self.heard if isinstance(message, MotionTruth)]

    def epochs(self) -> list[Epoch]:
        return [message for message in self.heard if isinstance(message, Epoch)]

    def since(self, mark: int) -> list[Message]:
        return self.heard[mark:]


def test_every_tenth_of_a_second_its_sensors_speak(tmp_path: Path) -> None:
    with manual_loop() as loop:
        stage = Stage(loop, tmp_path, GNSS)
        assert stage.node.is_ready.is_set()
        loop.advance(20.0)
        assert len(stage.truth()) in (199, 200)
        assert len(stage.tacho()) == len(stage.truth())
        # The inertial sensor's first sample comes 0.3 s late; from then on ten to a block.
        assert len(stage.imu()) == len(stage.truth()) - 3
        blocks = stage.imu()
        assert {len(block.offset_ns) for block in blocks} == {10}
        assert [block.first_sample for block in blocks] == list(range(0, 10 * len(blocks), 10))
        assert np.array_equal(blocks[0].offset_ns, np.arange(-9, 1) * 10_000_000)
        assert blocks[-1].t_ns == stage.tacho()[-1].t_ns == stage.truth()[-1].t_ns
        assert 0 <= stage.clock.now_ns() - blocks[-1].t_ns < 0.1 * NS
        assert len(stage.epochs()) == len(stage.truth()) // 2
        assert any(isinstance(message, Ephemeris) for message in stage.heard)


def test_counts_speed_and_place_belong_together(tmp_path: Path) -> None:
    with manual_loop() as loop:
        stage = Stage(loop, tmp_path, DRY + "[tacho]\nwheel_scale = 0.0\n")
        loop.advance(120.0)
        first, last = stage.truth()[0], stage.truth()[-1]
        gone_m = last.distance_m - first.distance_m
        assert gone_m > 500.0
        assert last.axis_m - first.axis_m == gone_m
        counts = int(stage.tacho()[-1].pulses[-1] - stage.tacho()[0].pulses[-1])
        # Micro-slip is a few per mille.
        assert abs(counts * np.pi * 0.816 / 90 / gone_m - 1.0) < 0.006
        passed = [message for message in stage.heard if isinstance(message, BalisePassage)]
        assert [one.balise for one in passed] == ["B01"]
        there = np.interp(passed[0].t_ns, [t.t_ns for t in stage.truth()], [t.axis_m for t in stage.truth()])
        # B01 lies at 280 m; a reader is off by up to three times 0.2 m, never beyond the bound that it gives.
        assert abs(there - 280.0) < passed[0].detection_bound_m


def test_epochs_are_where_the_train_is(tmp_path: Path) -> None:
    with manual_loop() as loop:
        stage = Stage(loop, tmp_path, GNSS)
        loop.advance(30.0)
        antennas = {m.t_ns: m for m in stage.heard if isinstance(m, TrainTruth)}
        for truth in stage.truth():
            if truth.t_ns in antennas:
                # The receiver's clock is off by less than half a millisecond: 15 mm at 30 m/s.
                assert abs(antennas[truth.t_ns].axis_m - truth.axis_m) < 0.015
        assert min(len(epoch.satellites) for epoch in stage.epochs()) >= 8


def test_a_slide_can_be_switched_on_and_ends_by_itself(tmp_path: Path) -> None:
    with manual_loop() as loop:
        stage = Stage(loop, tmp_path, DRY)
        loop.advance(30.0)
        assert {truth.slip for truth in stage.truth()} == {0}
        stage.fault("slide", magnitude=4.0, duration_s=5.0)
        loop.advance(4.9)
        assert "fault_slide" in stage.node.health._reasons
        counts = [int(block.pulses[-1]) for block in stage.tacho()[-11:]]
        speed = stage.truth()[-1].speed_mps
        rim = (counts[-1] - counts[0]) * np.pi * 0.816 / 90
        # Over the last second the rim is 4 m/s slower than the train, which powers at up to 0.75 m/s².
        assert abs(speed - rim - 4.0) < 0.6
        assert stage.truth()[-1].slip == -1
        loop.advance(2.0)
        assert stage.truth()[-1].slip == 0
        assert "fault_slide" not in stage.node.health._reasons


def test_sensor_faults_come_and_go(tmp_path: Path) -> None:
    with manual_loop() as loop:
        stage = Stage(loop, tmp_path, DRY)
        loop.advance(30.0)
        mark = len(stage.heard)
        stage.fault("imu_lost")
        stage.fault("tacho_stuck")
        loop.advance(3.0)
        after = stage.since(mark)
        assert not any(isinstance(message, ImuBlock) for message in after)
        assert len({int(m.pulses[-1]) for m in after if isinstance(m, TachoBlock)}) == 1
        stage.fault("imu_lost", active=False)
        stage.fault("tacho_stuck", active=False)
        mark = len(stage.heard)
        loop.advance(3.0)
        after = stage.since(mark)
        blocks = [m for m in after if isinstance(m, ImuBlock)]
        # Samples went on being counted: the gap shows in their numbers.
        before = max(m.first_sample for m in stage.heard[:mark] if isinstance(m, ImuBlock))
        assert blocks[0].first_sample >= before + 300
        assert len({int(m.pulses[-1]) for m in after if isinstance(m, TachoBlock)}) > 10


def test_faults_beyond_all_sense_are_refused_and_the_train_runs_on(tmp_path: Path) -> None:
    with manual_loop() as loop:
        stage = Stage(loop, tmp_path, DRY)
        loop.advance(2.0)
        for magnitude in (1e300, -1.0, float("nan"), float("inf")):
            stage.fault("imu_late", magnitude=magnitude)
        stage.fault("slide", duration_s=float("inf"))
        loop.advance(2.0)
        assert stage.node.health.counts["faults_refused"] == 5
        assert not any(reason.startswith("fault_") for reason in stage.node.health._reasons)
        assert stage.truth()[-1].t_ns > START_NS + 3 * NS


def test_gnss_can_be_lost_and_biases_added(tmp_path: Path) -> None:
    with manual_loop() as loop:
        stage = Stage(loop, tmp_path, GNSS + "[imu]\nnoise = 0.0\nvibration = 0.0\n")
        loop.advance(1.0)
        rest = stage.imu()[-1].gy_radps.mean()
        stage.fault("gnss_lost")
        stage.fault("gyro_bias", magnitude=0.01)
        loop.advance(1.0)
        assert stage.epochs()[-1].satellites == ()
        # At rest, without noise; what remains is the warming sensor's drift.
        assert abs(stage.imu()[-1].gy_radps.mean() - rest - 0.01) < 1e-5
        stage.fault("gnss_lost", active=False)
        loop.advance(2.0)
        assert len(stage.epochs()[-1].satellites) >= 8


def test_a_counter_that_begins_anew_is_unwrapped_and_counted(tmp_path: Path) -> None:
    with manual_loop() as loop:
        stage = Stage(loop, tmp_path, DRY + "[tacho]\ncounter_bits = 16\n")
        loop.advance(60.0)
        before = int(stage.tacho()[-1].pulses[-1])
        stage.fault("tacho_reset")
        loop.advance(5.0)
        assert stage.tacho()[-1].resets == 1
        assert int(stage.tacho()[-1].pulses[-1]) > before
        assert np.all(np.diff([int(block.pulses[-1]) for block in stage.tacho()]) >= 0)


def test_the_same_seed_gives_the_same_bytes_and_a_fleet_follows(tmp_path: Path) -> None:
    with manual_loop() as loop:
        stages = [Stage(loop, tmp_path, DRY, **kind) for kind in ({}, {}, {"seed": 9}, {"under_way_s": 60.0})]
        loop.advance(10.0)
        encoded = [[encode(m) for m in stage.heard if isinstance(m, ImuBlock | TachoBlock)] for stage in stages]
        assert encoded[0] == encoded[1]
        assert encoded[0] != encoded[2]
        assert stages[3].truth()[0].axis_m > stages[0].truth()[-1].axis_m + 200.0


def test_ticks_missed_while_the_host_slept_are_left_out_and_the_train_runs_on(tmp_path: Path) -> None:
    with manual_loop() as loop:
        stage = Stage(loop, tmp_path, DRY)
        loop.advance(30.0)
        before = stage.truth()[-1]
        loop._now_s += 20.0
        loop.advance(0.5)
        after = stage.truth()[-1]
        assert stage.node.health.counts["ticks_skipped"] >= 199
        assert stage.clock.now_ns() - after.t_ns < 0.1 * NS
        assert after.distance_m > before.distance_m + 150.0


def test_a_line_that_is_not_there_ends_it_with_the_reason(tmp_path: Path) -> None:
    with manual_loop() as loop:
        stage = Stage(loop, tmp_path, 'name = "x"\nline = "nowhere.json"\n')
        assert "nowhere.json" in repr(stage.task.exception())
