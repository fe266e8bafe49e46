"""Sources of bytes: a serial line that is asked, a file that grows, shrinks and goes away, a pipe that ends."""

from __future__ import annotations

import os
from pathlib import Path

import msgspec
import pytest

from services.byte_source.serial_stream import SerialLine
from services.byte_source.source import SourceError
from services.byte_source.tcp_socket import TcpConnection
from services.radio_probe.input_stream import GrowingFile, SourceEndedError, StandardInput, modem_line, source_of
from services.radio_probe.settings import Config, RadioInput


def settings(**fields: object) -> RadioInput:
    return msgspec.convert({"device": "d", **fields}, RadioInput)


def test_a_serial_line_is_asked_and_answers() -> None:
    controller, device = os.openpty()
    try:
        line = SerialLine(os.ttyname(device), 9600)
        with pytest.raises(SourceError, match="not open"):
            line.write(b"AT\r\n")
        line.open()
        line.write(b"AT+CSQ\r\n")
        assert os.read(controller, 100) == b"AT+CSQ\r\n"
        os.write(controller, b"+CSQ: 20,99\r\n")
        got = b""
        while not got.endswith(b"\n"):
            got += line.read()
        assert got == b"+CSQ: 20,99\r\n"
        line.close()
    finally:
        os.close(controller)
        os.close(device)


def test_a_connection_that_is_not_open_cannot_be_asked() -> None:
    with pytest.raises(SourceError, match="not open"):
        TcpConnection("127.0.0.1", 1).write(b"AT\r\n")


def test_a_file_is_read_on_and_begun_anew_when_it_is_another(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    source = GrowingFile(str(path))
    with pytest.raises(SourceError, match="cannot be opened: No such file"):
        source.open()
    with pytest.raises(SourceError, match="not open"):
        source.read()
    path.write_bytes(b"one\n")
    source.open()
    assert (source.read(), source.read()) == (b"one\n", b"")
    with path.open("ab") as stream:
        stream.write(b"two\n")
    assert source.read() == b"two\n"
    path.write_bytes(b"cut\n")
    assert source.read() == b"cut\n"
    path.rename(tmp_path / "log.1")
    with pytest.raises(SourceError, match="cannot be read"):
        source.read()
    path.write_bytes(b"new\n")
    assert source.read() == b"new\n"
    source.close()


def test_a_pipe_has_an_end() -> None:
    reading, writing = os.pipe()
    try:
        source = StandardInput(reading)
        source.open()
        os.write(writing, b"row\n")
        assert source.read() == b"row\n"
        assert source.read() == b""
        os.close(writing)
        with pytest.raises(SourceEndedError):
            source.read()
        source.close()
    finally:
        os.close(reading)


def test_sources_by_their_settings() -> None:
    assert source_of(settings(file="x")).name == "file x"
    assert source_of(settings(tcp={"host": "h", "port": 9})).name == "tcp h:9"
    line = modem_line(settings(format="modem", serial={"port": "/dev/ttyX", "baud": 9600}))
    assert line.name == "serial /dev/ttyX at 9600 baud"
    with pytest.raises(TypeError, match="over serial or tcp"):
        modem_line(settings(file="x"))


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({}, "give one of serial, tcp, file and standard_input"),
        ({"file": "x", "standard_input": True}, "give one of"),
        ({"file": "x", "format": "modem"}, "asked over serial or tcp"),
        ({"file": "x", "format": "scan"}, "scan and bands belong together"),
        ({"file": "x", "bands": [{"channel": "a", "low_hz": 1.0, "high_hz": 2.0}]}, "belong together"),
        ({"file": "x", "format": "scan", "bands": [{"channel": "a", "low_hz": 2.0, "high_hz": 2.0}]}, "is not below"),
        (
            {"tcp": {"host": "h", "port": 9}, "format": "modem", "carries": "weather"},
            "weather comes as csv or json",
        ),
    ],
)
def test_settings_that_do_not_fit_are_refused(fields: dict[str, object], words: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=words):
        settings(**fields)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"bus": False}, "give inputs"),
        ({"inputs": [{"device": "a", "file": "x"}, {"device": "a", "file": "y"}]}, "same device name"),
        (
            {"inputs": [{"device": name, "standard_input": True} for name in "ab"]},
            "only one input can have the standard input",
        ),
    ],
)
def test_configurations_that_cannot_be_are_refused(table: dict[str, object], words: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(table, Config)
