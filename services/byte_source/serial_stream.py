"""Bytes of a receiver from a serial line."""

from __future__ import annotations

import serial

from services.byte_source.source import CHUNK, READ_S, WRITE_S, SourceError


class SerialLine:
    """A serial device with eight bits, no parity, one stop bit."""

    def __init__(self, port: str, baud: int) -> None:
        """Know the device; `open` opens it."""
        self._port = port
        self._baud = baud
        self._line: serial.Serial | None = None

    @property
    def name(self) -> str:
        """Device and rate."""
        return f"serial {self._port} at {self._baud} baud"

    def open(self) -> None:
        """Open the device for this process alone. Raises SourceError."""
        self.close()
        try:
            self._line = serial.Serial(self._port, self._baud, timeout=READ_S, write_timeout=WRITE_S, exclusive=True)
        except (OSError, ValueError) as error:
            msg = f"it cannot be opened: {error}"
            raise SourceError(msg) from error

    def read(self) -> bytes:
        """Bytes that have come; see `ByteSource.read`."""
        if self._line is None:
            msg = "the line is not open"
            raise SourceError(msg)
        try:
            return bytes(self._line.read(min(max(self._line.in_waiting, 1), CHUNK)))
        except OSError as error:
            msg = f"it broke: {error}"
            raise SourceError(msg) from error

    def write(self, octets: bytes) -> None:
        """Send bytes. Raises SourceError."""
        if self._line is None:
            msg = "the line is not open"
            raise SourceError(msg)
        try:
            self._line.write(octets)
        except OSError as error:
            msg = f"it broke: {error}"
            raise SourceError(msg) from error

    def close(self) -> None:
        """Close the device."""
        if self._line is not None:
            self._line.close()
            self._line = None
