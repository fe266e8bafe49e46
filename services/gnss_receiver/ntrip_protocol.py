"""What an NTRIP client says and understands: requests, answers, chunks.

Sources: NTRIP 1.0 (RTCM 10410.0) and 2.0 (RTCM 10410.1); chunked transfer: RFC 9112, 7.1.
"""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass
from typing import Final

_AGENT: Final = "NTRIP kirotei"
_LONGEST_HEAD: Final = 16_384
_LONGEST_CHUNK: Final = 1 << 20
_STATUS: Final = re.compile(r"(ICY|SOURCETABLE|HTTP/\d\.\d) (\d{3})(?: (.*))?")
_OK, _NO_ACCESS, _NOWHERE = 200, (401, 403), 404
_SHOWN: Final = 20
"""Mountpoints that an error names."""


class NtripError(Exception):
    """An answer that gives no stream; says in words why and what to do."""


@dataclass(frozen=True, slots=True)
class Opened:
    """An answer that a stream follows."""

    chunked: bool
    rest: bytes
    """First bytes of the stream, which came with the answer."""


def request(host: str, mountpoint: str, version: int, user: str, password: str) -> bytes:
    """Request of a stream; `user` may be empty."""
    lines = [f"GET /{mountpoint} HTTP/1.{version - 1}"]
    if version > 1:
        lines += [f"Host: {host}", "Ntrip-Version: Ntrip/2.0"]
    lines.append(f"User-Agent: {_AGENT}")
    if user:
        secret = base64.b64encode(f"{user}:{password}".encode()).decode("ascii")
        lines.append(f"Authorization: Basic {secret}")
    if version > 1:
        lines.append("Connection: close")
    return "\r\n".join([*lines, "", ""]).encode()


def answer(received: bytes, mountpoint: str) -> Opened | None:
    """What the answer so far says; None while more of it must come. Raises NtripError for a refusal."""
    first, ended, after = received.partition(b"\n")
    if not ended:
        if len(received) > _LONGEST_HEAD:
            msg = "what answers is no NTRIP caster: its answer has no end"
            raise NtripError(msg)
        return None
    line = first.decode("latin-1").strip()
    if line.upper().startswith("ERROR"):
        msg = f"the caster refuses: {line}; check user, password and mountpoint"
        raise NtripError(msg)
    status = _STATUS.fullmatch(line)
    if status is None:
        msg = f"what answers is no NTRIP caster: {line[:80]!r}"
        raise NtripError(msg)
    if status[1] == "ICY" and int(status[2]) == _OK:
        # The stream begins at once; further lines of the head, which some casters send, are no messages.
        return Opened(chunked=False, rest=after)
    head, blank, body = received.partition(b"\r\n\r\n")
    if not blank:
        return None
    fields = _fields(head)
    if status[1] == "SOURCETABLE" or "sourcetable" in fields.get("content-type", ""):
        if b"ENDSOURCETABLE" not in body and len(body) < _LONGEST_HEAD:
            return None
        raise NtripError(_missing(body, mountpoint))
    if int(status[2]) != _OK:
        raise NtripError(_refusal(int(status[2]), line, mountpoint))
    return Opened(chunked="chunked" in fields.get("transfer-encoding", ""), rest=body)


def _fields(head: bytes) -> dict[str, str]:
    pairs = (line.partition(":") for line in head.decode("latin-1").split("\r\n")[1:])
    return {name.strip().lower(): value.strip().lower() for name, _, value in pairs}


def _refusal(code: int, line: str, mountpoint: str) -> str:
    if code in _NO_ACCESS:
        return f"the caster refuses user or password for {mountpoint!r} ({line})"
    if code == _NOWHERE:
        return f"the caster has no mountpoint {mountpoint!r} ({line})"
    return f"the caster refuses: {line}"


def _missing(table: bytes, mountpoint: str) -> str:
    """What a source table means, which a caster sends instead of a stream."""
    lines = table.decode("latin-1").splitlines()
    names = sorted({line.split(";")[1] for line in lines if line.startswith("STR;") and line.count(";") > 1})
    known = ", ".join(names[:_SHOWN]) + (f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")
    return f"the caster has no mountpoint {mountpoint!r}; it has: {known or 'none'}"


class ChunkDecoder:
    """Takes the chunks of a chunked transfer apart, however they are cut."""

    def __init__(self) -> None:
        """Stand before the first chunk."""
        self._buffer = b""
        self._left = 0
        """Bytes of the current chunk that are to come, its line end included."""
        self.ended = False

    def feed(self, received: bytes) -> bytes:
        """Contents in what was received. Raises NtripError where no chunk stands."""
        self._buffer += received
        content = b""
        while self._buffer and not self.ended:
            if self._left:
                part = self._buffer[: self._left]
                # The line end after a chunk is its last two bytes.
                content += part[: max(self._left - 2, 0)]
                self._buffer = self._buffer[len(part) :]
                self._left -= len(part)
                continue
            size, ended, after = self._buffer.partition(b"\r\n")
            if not ended and len(size) < _SHOWN:
                break
            self._left = self._size(size) + 2
            self._buffer = after
            self.ended = self._left == 2  # noqa: PLR2004 - an empty chunk with its line end is the last
        return content

    @staticmethod
    def _size(text: bytes) -> int:
        digits = text.partition(b";")[0].strip()
        try:
            size = int(digits, 16)
        except ValueError:
            size = -1
        if not 0 <= size <= _LONGEST_CHUNK:
            msg = f"the transfer is broken: {digits[:20]!r} is no length of a chunk"
            raise NtripError(msg)
        return size
