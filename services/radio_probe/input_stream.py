"""Where a device's bytes come from: a serial line, a connection, a file that grows, the standard input."""

from __future__ import annotations

import os
import select
import sys
from io import BufferedReader
from pathlib import Path
from typing import Protocol

from services.byte_source.serial_stream import SerialLine
from services.byte_source.source import CHUNK, READ_S, SourceError
from services.byte_source.tcp_socket import TcpConnection
from services.radio_probe.settings import RadioInput

FILE_CHUNK = 65_536


class Source(Protocol):
    """A source that blocks for READ_S at most."""

    @property
    def name(self) -> str:
        """Where the bytes come from."""

    def open(self) -> None:
        """Connect. Raises SourceError."""

    def read(self) -> bytes:
        """Bytes that have come, none when nothing came. Raises SourceError when it is gone."""

    def close(self) -> None:
        """Disconnect."""


class SourceEndedError(Exception):
    """Nothing will ever come any more."""


class GrowingFile:
    """A file read from its beginning and followed as it grows; begun anew when it was replaced or became shorter."""

    def __init__(self, path: str) -> None:
        """Know the path."""
        self._path = Path(path)
        self._stream: BufferedReader | None = None

    @property
    def name(self) -> str:
        """Path."""
        return f"file {self._path}"

    def open(self) -> None:
        """Open at the beginning. Raises SourceError."""
        self.close()
        try:
            self._stream = self._path.open("rb")
        except OSError as error:
            msg = f"it cannot be opened: {error.strerror}"
            raise SourceError(msg) from error

    def read(self) -> bytes:
        """What has been added; see `Source.read`. Does not block."""
        if self._stream is None:
            msg = "the file is not open"
            raise SourceError(msg)
        try:
            chunk = self._stream.read(FILE_CHUNK)
            if not chunk and self._replaced(self._stream):
                self.open()
                chunk = self._stream.read(FILE_CHUNK)
        except OSError as error:
            msg = f"it cannot be read: {error.strerror}"
            raise SourceError(msg) from error
        return chunk

    def _replaced(self, stream: BufferedReader) -> bool:
        held, there = os.fstat(stream.fileno()), self._path.stat()
        return (held.st_dev, held.st_ino) != (there.st_dev, there.st_ino) or there.st_size < stream.tell()

    def close(self) -> None:
        """Close it."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None


class StandardInput:
    """What is piped into the service."""

    name = "the standard input"

    def __init__(self, descriptor: int | None = None) -> None:
        """Take the process's own unless another descriptor is given."""
        self._descriptor = sys.stdin.fileno() if descriptor is None else descriptor

    def open(self) -> None:
        """Nothing: it is open."""

    def read(self) -> bytes:
        """Bytes that have come; see `Source.read`. Raises SourceEndedError at its end."""
        try:
            if not select.select([self._descriptor], [], [], READ_S)[0]:
                return b""
            chunk = os.read(self._descriptor, CHUNK)
        except OSError as error:
            raise SourceEndedError from error
        if not chunk:
            raise SourceEndedError
        return chunk

    def close(self) -> None:
        """Nothing: it belongs to the process."""


def source_of(settings: RadioInput) -> Source:
    """Source that the settings of an input name; a modem's is a ModemLine."""
    if settings.serial is not None:
        return SerialLine(settings.serial.port, settings.serial.baud)
    if settings.tcp is not None:
        return TcpConnection(settings.tcp.host, settings.tcp.port)
    return StandardInput() if settings.standard_input else GrowingFile(settings.file)


def modem_line(settings: RadioInput) -> SerialLine | TcpConnection:
    """Line to a modem. Raises ValueError for settings without one."""
    line = source_of(settings)
    if not isinstance(line, SerialLine | TcpConnection):
        msg = f"{settings.device}: a modem is asked over serial or tcp"
        raise TypeError(msg)
    return line
