"""Where the radio probe reads from: files that grow, scans of power, modems, pipes."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import msgspec
import pytest

from schemas.radio import Weather
from services.byte_source.settings import TcpSource
from services.radio_probe.settings import Band, Config, RadioInput
from services.runtime.manual_loop import manual_loop
from tests.replay.probe_stage import NS, START_NS, ProbeStage


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
        stage = ProbeStage(loop, Config(bus=False, inputs=(csv_input(file),)))
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
        stage = ProbeStage(loop, Config(bus=False, inputs=(settings,)))
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
        stage = ProbeStage(loop, Config(bus=False, wait_s=0.2, inputs=(settings,)))
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
        stage = ProbeStage(loop, Config(bus=False, wait_s=0.2, inputs=(modem,)))
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


def test_what_is_piped_in_is_taken_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    os.write(writing, b'{"radio": "R02", "channel": "ch2", "received_ratio": 0.9}\n')
    os.close(writing)
    with os.fdopen(reading) as pipe, manual_loop() as loop:
        monkeypatch.setattr("sys.stdin", pipe)
        piped = RadioInput(device="pipe", standard_input=True, format="json")
        stage = ProbeStage(loop, Config(bus=False, wait_s=0.2, inputs=(piped,)))
        loop.advance(1.0)
        assert [one.received_ratio for one in stage.measurements()] == [0.9]
        assert "has ended" in str(stage.node.health.level(loop.time())[1])
        stage.end()
