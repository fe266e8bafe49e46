"""The radio probe on a virtual bus and clock: places, passes, faults of devices, files and modems."""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from schemas.codec import encode
from schemas.line import Direction
from schemas.message import Message
from schemas.position import TrainPosition
from schemas.radio import RadioMeasurement, Weather
from schemas.topic import Place
from schemas.topics import RADIO_MEASUREMENT, RADIO_READING, TRAIN_POSITION, WEATHER
from services.byte_source.settings import TcpSource
from services.radio_probe.service import SERVICE
from services.radio_probe.settings import Band, Config, RadioInput
from services.runtime.clock import ManualClock
from services.runtime.guest import guest
from services.runtime.manual_loop import ManualLoop, manual_loop
from services.runtime.memory_node import MemoryBus, MemoryNode

NS = 10**9
START_NS = 1_793_000_000 * NS
TRAIN = Place("demo", "train", "T1")
SITE = Place("demo", "wayside", "R02")
OUTSIDE = guest(
    "outside", "speaks and listens", reads=(RADIO_MEASUREMENT, WEATHER), writes=(RADIO_READING, TRAIN_POSITION)
)


class Stage:
    """The service under virtual time, and everything it has published."""

    def __init__(self, loop: ManualLoop, config: Config | None = None, place: Place = TRAIN) -> None:
        self.loop, self.heard = loop, list[Message]()
        self.clock, self.bus = ManualClock(loop, START_NS), MemoryBus()
        self.outside = MemoryNode(self.bus, OUTSIDE, place, self.clock)
        self.train = MemoryNode(self.bus, OUTSIDE, TRAIN, self.clock)
        self.task = loop.create_task(self._start(config or Config(), place))
        loop.settle()

    async def _start(self, config: Config, place: Place) -> None:
        self.node = MemoryNode(self.bus, SERVICE, place, self.clock)
        arrivals = self.outside.arrivals(RADIO_MEASUREMENT, WEATHER)

        async def listen() -> None:
            async for arrival in arrivals:
                self.heard.append(arrival.message)

        async with asyncio.TaskGroup() as group:
            group.create_task(listen())
            await self.node.run(config)
            self.outside.stop()

    def end(self) -> None:
        self.node.stop()
        self.loop.advance(5.0)
        assert self.task.done()
        self.task.result()

    def say(self, t_s: float, **fields: object) -> None:
        """A device's report of a time since the start."""
        known: dict[str, object] = {"radio": "R02", "channel": "ch2", "channel_power_dbm": -70.0}
        message = RadioMeasurement(t_ns=START_NS + round(t_s * NS), **(known | fields))  # type: ignore[arg-type]  # any field
        self.loop.create_task(self.outside.publish(RADIO_READING, message, device="radio"))
        self.loop.settle()

    def stand(self, t_s: float, axis_m: float | None, speed_mps: float = 20.0, facing: Direction = "up") -> None:
        """A position of a time since the start; lost without a place."""
        position = TrainPosition(
            t_ns=START_NS + round(t_s * NS),
            status="valid" if axis_m is not None else "lost",
            reason="" if axis_m is not None else "no odometry",
            branch="",
            axis_m=axis_m,
            chainage_m=None if axis_m is None else 4200.0 + axis_m,
            direction=facing,
            speed_mps=speed_mps,
            bound_ahead_m=4.0,
            bound_behind_m=3.0,
        )
        self.loop.create_task(self.train.publish(TRAIN_POSITION, position))
        self.loop.settle()

    def measurements(self) -> list[RadioMeasurement]:
        return [one for one in self.heard if isinstance(one, RadioMeasurement)]

    def run(self, until_s: float, place: Callable[[float], float | None], **fields: object) -> None:
        """A report every half second and positions every tenth, both 0.3 s late, until a time."""
        while (now_s := (self.clock.now_ns() - START_NS) / NS) < until_s:
            tick = round(now_s * 10)
            self.stand((tick - 3) / 10, place((tick - 3) / 10))
            if tick % 5 == 0:
                self.say((tick - 2.5) / 10, **fields)
            self.loop.advance(0.1)


def test_a_report_gets_the_place_of_its_own_time() -> None:
    with manual_loop() as loop:
        stage = Stage(loop)
        stage.run(10.0, lambda t_s: 1000.0 + 20.0 * t_s)
        got = stage.measurements()
        assert len(got) >= 18
        for one in got[1:]:
            gone_s = (one.t_ns - START_NS) / NS
            # Interpolated between positions that are exact here; places are rounded to centimetres.
            assert one.axis_m == pytest.approx(1000.0 + 20.0 * gone_s, abs=0.006)
            assert one.chainage_m == pytest.approx(5200.0 + 20.0 * gone_s, abs=0.006)
            assert (one.direction, one.speed_mps, one.place_bound_m, one.branch) == ("up", 20.0, 4.0, "")
        assert {one.pass_id for one in got[1:]} == {"T1-20261026T073319Z-up"}
        assert [one.t_ns for one in got] == sorted(one.t_ns for one in got)
        assert stage.node.health.level(loop.time())[0] == "ok"
        stage.end()


def test_without_a_position_reports_go_out_without_a_place_and_health_says_so() -> None:
    with manual_loop() as loop:
        stage = Stage(loop)
        stage.run(4.0, lambda t_s: 1000.0 + 20.0 * t_s if t_s < 2.0 else None)
        unplaced = [one for one in stage.measurements() if one.axis_m is None and one.t_ns > START_NS + NS]
        assert unplaced
        assert all(one.direction is None and one.pass_id == "" for one in unplaced)
        assert "the position is lost: no odometry" in stage.node.health.level(loop.time())[1][0]
        before = len(stage.measurements())
        stage.say(50.0)
        loop.advance(2.9)
        assert len(stage.measurements()) == before
        loop.advance(0.4)
        assert len(stage.measurements()) == before + 1
        stage.run(12.0, lambda t_s: 1200.0 + 20.0 * t_s)
        assert stage.node.health.level(loop.time())[0] == "ok"
        assert stage.node.health.counts["without_place"] >= len(unplaced)
        stage.end()


def test_a_reversal_and_a_cold_move_begin_new_passes() -> None:
    with manual_loop() as loop:
        stage = Stage(loop)
        names: list[tuple[str, Direction | None]] = []
        for tick in range(400):
            t_s = tick / 10
            if t_s < 10:
                stage.stand(t_s, 1000.0 + 20.0 * t_s)
            elif t_s < 20:  # the other cab leads: its end is the front end now
                stage.stand(t_s, 1100.0 - 20.0 * (t_s - 10), facing="down")
            elif t_s < 30:  # it sets back
                stage.stand(t_s, 900.0 + 20.0 * (t_s - 20), speed_mps=-20.0, facing="down")
            else:  # and was towed away
                stage.stand(t_s, 9000.0 + 20.0 * (t_s - 30))
            if tick % 10 == 5:
                stage.say(t_s)
            loop.advance(0.1)
        for one in stage.measurements():
            if not names or names[-1] != (one.pass_id, one.direction):
                names.append((one.pass_id, one.direction))
        assert [direction for _, direction in names] == ["up", "down", "up", "up"]
        assert len({name for name, _ in names}) == 4
        stage.end()


def test_what_a_device_says_twice_or_cannot_mean_is_refused_and_counted() -> None:
    with manual_loop() as loop:
        stage = Stage(loop)
        stage.say(0.0)
        stage.say(0.0)
        stage.say(0.1, channel_power_dbm=900.0)
        stage.say(0.2, decoded_power_dbm=float("nan"))
        stage.say(0.3, channel_power_dbm=None)
        stage.say(0.4, channel_power_dbm=None, received_ratio=0.0)
        loop.advance(4.0)
        assert [round((one.t_ns - START_NS) / NS, 1) for one in stage.measurements()] == [0.0, 0.4]
        counts = stage.node.health.counts
        assert {name: counts[name] for name in ("doubled", "absurd", "nothing_measured")} == {
            "doubled": 1,
            "absurd": 2,
            "nothing_measured": 1,
        }
        assert stage.node.health.level(loop.time())[0] == "degraded"
        stage.end()


@pytest.mark.parametrize("year_ns", [315_532_800 * NS, 2_082_758_400 * NS], ids=["1980", "2036"])
def test_a_device_with_a_reset_clock_is_placed_by_the_host_s_time(year_ns: int) -> None:
    with manual_loop() as loop:
        stage = Stage(loop)
        stage.run(3.0, lambda t_s: 1000.0 + 20.0 * t_s)
        before = len(stage.measurements())
        stage.say((year_ns - START_NS) / NS)
        stage.run(6.0, lambda t_s: 1000.0 + 20.0 * t_s)
        there = [one for one in stage.measurements()[before:] if one.t_ns == START_NS + 3 * NS]
        assert [one.axis_m for one in there] == [1060.0]
        assert stage.node.health.counts["clock_off"] == 1
        stage.end()


def test_recordings_keep_their_own_time() -> None:
    with manual_loop() as loop:
        stage = Stage(loop, Config(bus_stamps="device"))
        stage.say(-40_000_000.0, chainage_m=7000.0, direction="down", pass_id="night")
        got = stage.measurements()
        assert [(one.t_ns, one.chainage_m, one.pass_id) for one in got] == [
            (START_NS - 40_000_000 * NS, 7000.0, "night")
        ]
        stage.end()


def test_on_the_wayside_the_transmitting_train_s_place_is_taken() -> None:
    with manual_loop() as loop:
        stage = Stage(loop, place=SITE)
        stage.run(5.0, lambda t_s: 3000.0 - 20.0 * t_s, train="T1", side="wayside")
        stage.say(4.9, train="T9")
        stage.say(4.95)
        loop.advance(4.0)
        got = stage.measurements()
        assert {one.train for one in got} == {"T1", "T9", ""}
        placed = [one for one in got if one.axis_m is not None]
        assert len(placed) >= 8
        for one in placed:
            assert one.axis_m == pytest.approx(3000.0 - 20.0 * (one.t_ns - START_NS) / NS, abs=0.006)
        assert all(one.axis_m is None for one in got if one.train != "T1")
        # A wayside radio that does not know who sends is no trouble; a train that nobody hears of is.
        assert "no position of T9 is heard" in str(stage.node.health.level(loop.time())[1])
        stage.end()


def csv_input(path: Path, **fields: object) -> RadioInput:
    return msgspec.convert({"device": "logger", "file": str(path), **fields}, RadioInput)


def test_a_file_is_followed_and_what_is_wrong_in_it_is_counted(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    file.write_text(
        "time,radio,channel,power_dbm,colour\n"
        "2026-10-26T07:33:21Z,R02,ch2,-71.5,blue\n"
        "2026-10-26T07:33:21.5Z,R02,ch2,nan,blue\n"
        "2026-10-26T07:33:22,R02,ch2,-72,blue\n"
        "broken\n",
        "utf-8",
    )
    with manual_loop() as loop:
        stage = Stage(loop, Config(bus=False, inputs=(csv_input(file),)))
        loop.advance(4.0)
        assert [one.channel_power_dbm for one in stage.measurements()] == [-71.5, -72.0]
        counts = stage.node.health.counts
        assert counts["nothing_measured"] == counts["logger_not_a_number"] == counts["logger_broken_lines"] == 1
        assert counts["logger_unknown_columns"] == counts["logger_times_without_zone"] == 1
        with file.open("a", encoding="utf-8") as stream:
            stream.write("2026-10-26T07:33:24Z,R02,ch2,-73,blue\n")
        loop.advance(4.0)
        assert [one.channel_power_dbm for one in stage.measurements()] == [-71.5, -72.0, -73.0]
        file.unlink()
        file.write_text("time,radio,channel,power_dbm,colour\n2026-10-26T07:33:28Z,R02,ch2,-74,\n", "utf-8")
        loop.advance(4.0)
        assert stage.measurements()[-1].channel_power_dbm == -74.0
        stage.end()


def test_weather_comes_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "weather.jsonl"
    file.write_text(
        '{"t_s": 1793000001, "temperature_c": -3.5, "snow_mm_per_h": 2.0}\n{"temperature_c": 999}\n', "utf-8"
    )
    with manual_loop() as loop:
        settings = csv_input(file, format="json", carries="weather", axis_m=2500.0)
        stage = Stage(loop, Config(bus=False, inputs=(settings,)))
        loop.advance(1.0)
        assert stage.heard == [
            Weather(t_ns=START_NS + NS, axis_m=2500.0, temperature_c=-3.5, snow_mm_per_h=2.0),
        ]
        assert stage.node.health.counts["absurd"] == 1
        stage.end()


def test_a_power_scan_becomes_channels(tmp_path: Path) -> None:
    file = tmp_path / "scan.csv"
    line = "2026-10-26, 07:33:2{0}, 2400000000, 2402000000, 500000, 8, -40, -43.01, -43.01, nan, nan\n"
    file.write_text(line.format(1) + line.format(2), "utf-8")
    with manual_loop() as loop:
        band = Band(channel="ch2", low_hz=2.4005e9, high_hz=2.402e9)
        settings = csv_input(file, format="scan", bands=[msgspec.to_builtins(band)], calibration_db=-30.0)
        stage = Stage(loop, Config(bus=False, wait_s=0.2, inputs=(settings,)))
        loop.advance(8.0)
        # Two bins of half the power that 0 dB more would be: -40 dB, and the calibration.
        assert [(one.channel, one.channel_power_dbm) for one in stage.measurements()] == [("ch2", -70.0)] * 2
        assert stage.node.health.counts["logger_empty_bins"] == 2
        stage.end()


def test_a_modem_is_asked_and_asked_again_after_its_line_broke(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.byte_source.tcp_socket.READ_S", 0.01)
    server = socket.create_server(("127.0.0.1", 0))
    tcp = TcpSource(host="127.0.0.1", port=server.getsockname()[1])
    modem = RadioInput(device="modem", tcp=tcp, format="modem", channel="lte", commands=("AT+CEREG?", "AT+CESQ"))
    with manual_loop() as loop:
        stage = Stage(loop, Config(bus=False, wait_s=0.2, inputs=(modem,)))
        connection, _ = server.accept()
        for words, answer in (
            (b"AT+CEREG?\r\n", b'\r\n+CEREG: 2,1,"1A2B","01C0FFEE",7\r\n\r\nOK\r\n'),
            (b"AT+CESQ\r\n", b"\r\n+CESQ: 99,99,255,255,20,80\r\n\r\nOK\r\n"),
        ):
            loop.advance(0.1)
            assert connection.recv(100) == words
            connection.sendall(answer)
            loop.advance(0.1)
        loop.advance(1.0)
        got = stage.measurements()
        # RSRP step 80 is -61 dBm to -60 dBm, RSRQ step 20 is -10 dB to -9.5 dB.
        assert [(one.decoded_power_dbm, one.rsrq_db, one.cell, one.channel) for one in got] == [
            (-60.5, -9.75, "01C0FFEE", "lte")
        ]
        connection.close()
        loop.advance(0.5)
        assert "trying again" in str(stage.node.health.level(loop.time())[1])
        loop.advance(1.5)
        again, _ = server.accept()
        loop.advance(0.5)
        assert again.recv(100) == b"AT+CEREG?\r\n"
        again.close()
        stage.end()
    server.close()


def test_the_same_reports_give_the_same_bytes() -> None:
    def once() -> list[bytes]:
        with manual_loop() as loop:
            stage = Stage(loop)
            stage.run(5.0, lambda t_s: 1000.0 + 20.0 * t_s)
            stage.end()
            return [encode(one) for one in stage.heard]

    first = once()
    assert len(first) > 5
    assert once() == first


def test_what_is_piped_in_is_taken_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    os.write(writing, b'{"radio": "R02", "channel": "ch2", "received_ratio": 0.9}\n')
    os.close(writing)
    with os.fdopen(reading) as pipe, manual_loop() as loop:
        monkeypatch.setattr("sys.stdin", pipe)
        piped = RadioInput(device="pipe", standard_input=True, format="json")
        stage = Stage(loop, Config(bus=False, wait_s=0.2, inputs=(piped,)))
        loop.advance(1.0)
        assert [one.received_ratio for one in stage.measurements()] == [0.9]
        assert "has ended" in str(stage.node.health.level(loop.time())[1])
        stage.end()
