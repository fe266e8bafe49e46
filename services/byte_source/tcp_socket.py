"""Bytes of a receiver from a TCP server."""

from __future__ import annotations

import socket

from services.byte_source.source import CHUNK, OPEN_S, READ_S, SourceError


class TcpConnection:
    """A connection to a host that sends to whoever connects."""

    def __init__(self, host: str, port: int) -> None:
        """Know the address; `open` connects."""
        self._address = host, port
        self._socket: socket.socket | None = None

    @property
    def name(self) -> str:
        """Address."""
        return f"tcp {self._address[0]}:{self._address[1]}"

    def open(self) -> None:
        """Connect. Raises SourceError."""
        self.close()
        try:
            self._socket = socket.create_connection(self._address, OPEN_S)
            self._socket.settimeout(READ_S)
        except OSError as error:
            msg = f"no connection: {error}"
            raise SourceError(msg) from error

    def read(self) -> bytes:
        """Bytes that have come; see `ByteSource.read`."""
        return receive(self._socket)

    def write(self, octets: bytes) -> None:
        """Send bytes. Raises SourceError."""
        if self._socket is None:
            msg = "the connection is not open"
            raise SourceError(msg)
        try:
            self._socket.sendall(octets)
        except OSError as error:
            msg = f"the connection broke: {error}"
            raise SourceError(msg) from error

    def close(self) -> None:
        """Disconnect."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def receive(connection: socket.socket | None) -> bytes:
    """Bytes that have come, none within the socket's time-out. Raises SourceError when the other end is gone."""
    if connection is None:
        msg = "the connection is not open"
        raise SourceError(msg)
    try:
        chunk = connection.recv(CHUNK)
    except TimeoutError:
        return b""
    except OSError as error:
        msg = f"the connection broke: {error}"
        raise SourceError(msg) from error
    if not chunk:
        msg = "the other end closed the connection"
        raise SourceError(msg)
    return chunk
