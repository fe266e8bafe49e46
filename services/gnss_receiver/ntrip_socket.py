"""Bytes of a stream of an NTRIP caster."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

from services.byte_source.source import OPEN_S, READ_S, SourceError
from services.byte_source.tcp_socket import receive
from services.gnss_receiver.ntrip_protocol import ChunkDecoder, NtripError, answer, request
from services.gnss_receiver.password_file import read_password
from services.gnss_receiver.reception import NtripSource
from services.gnss_receiver.tls_socket import secured

REPORT_S = 10.0
"""Interval at which the position is reported."""


class NtripConnection:
    """A stream of a caster."""

    def __init__(self, source: NtripSource, report: Callable[[], bytes] | None = None) -> None:
        """Know the caster; `open` connects. `report` gives the sentence for a caster that wants a position."""
        self._source = source
        self._report = report
        self._socket: socket.socket | None = None
        self._chunks: ChunkDecoder | None = None
        self._first = b""
        self._reported_s = 0.0

    @property
    def name(self) -> str:
        """Caster and mountpoint."""
        return f"ntrip {self._source.host}:{self._source.port}/{self._source.mountpoint}"

    def open(self) -> None:
        """Connect and ask for the stream. Raises SourceError."""
        self.close()
        try:
            self._socket = self._connected()
            self._ask(self._socket)
            self._socket.settimeout(READ_S)
        except (OSError, ValueError) as error:
            self.close()
            msg = f"no connection: {error}"
            raise SourceError(msg) from error
        except NtripError as error:
            self.close()
            raise SourceError(str(error)) from error

    def _connected(self) -> socket.socket:
        plain = socket.create_connection((self._source.host, self._source.port), OPEN_S)
        return secured(plain, self._source.host, self._source.authority_file) if self._source.tls else plain

    def _ask(self, connection: socket.socket) -> None:
        source = self._source
        password = read_password(source.password_file, source.password_variable)
        connection.sendall(request(source.host, source.mountpoint, source.version, source.user, password))
        received = b""
        opened = None
        until_s = time.monotonic() + OPEN_S
        while opened is None:
            if time.monotonic() > until_s:
                msg = f"the caster does not answer within {OPEN_S:.0f} s"
                raise NtripError(msg)
            chunk = connection.recv(4096)
            if not chunk:
                msg = f"the caster closed the connection after {received[:80]!r}"
                raise NtripError(msg)
            received += chunk
            opened = answer(received, source.mountpoint)
        self._chunks = ChunkDecoder() if opened.chunked else None
        self._first = opened.rest
        self._reported_s = -REPORT_S

    def read(self) -> bytes:
        """Bytes that have come; see `ByteSource.read`."""
        self._send_report()
        received, self._first = self._first, b""
        if not received:
            received = receive(self._socket)
        if self._chunks is None:
            return received
        try:
            content = self._chunks.feed(received)
        except NtripError as error:
            raise SourceError(str(error)) from error
        if self._chunks.ended and not content:
            msg = "the caster ended the stream"
            raise SourceError(msg)
        return content

    def _send_report(self) -> None:
        now_s = time.monotonic()
        if self._report is None or self._socket is None or now_s - self._reported_s < REPORT_S:
            return
        self._reported_s = now_s
        try:
            self._socket.sendall(self._report())
        except OSError as error:
            msg = f"the connection broke: {error}"
            raise SourceError(msg) from error

    def close(self) -> None:
        """Disconnect."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
