"""Bytes of a RINEX file on disk: read from whatever they are packed in, and written whole or not at all."""

from __future__ import annotations

import warnings
import zipfile
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import hatanaka

from services.gnss_receiver.observations import FileIssue
from services.gnss_receiver.rinex_error import RinexError
from services.gnss_receiver.rinex_header import COMPACT_VERSION, LABEL_AT

MAX_BYTES = 4 << 30
"""What unpacks to more is refused: it would not fit into the memory of a train's computer."""
_GZIP, _LZW, _BZIP2, _ZIP = b"\x1f\x8b", b"\x1f\x9d", b"BZh", b"PK\x03\x04"
_GZIP_WINDOW = 16 + zlib.MAX_WBITS

# Hatanaka's own and an encrypted zip are RuntimeErrors; bz2 and compress raise the others.
_UNPACKING_ERRORS = (RuntimeError, ValueError, OSError, EOFError, zlib.error, zipfile.BadZipFile)


@dataclass(frozen=True, slots=True)
class Unpacked:
    """Text of a file, and what its packing did not give."""

    content: bytes
    issues: tuple[FileIssue, ...] = ()


def read_bytes(path: Path) -> Unpacked:
    """Text of a RINEX file: plain, gzip, compress (.Z), bzip2, zip or Hatanaka, by what it holds.

    A gzip file that is cut short gives what is there. Raises RinexError when the packing is
    damaged otherwise, OSError when the file cannot be read.
    """
    content = path.read_bytes()
    unpacked = _gunzip(content, path) if content.startswith(_GZIP) else Unpacked(content)
    if unpacked.content.startswith((_LZW, _BZIP2, _ZIP)) or _is_compact(unpacked.content):
        further = _unpack(unpacked.content, path)
        return Unpacked(further.content, unpacked.issues + further.issues)
    return unpacked


def write_lines(path: Path, lines: Iterable[str]) -> None:
    """Write a file of lines, beside its place first: a failure leaves what stood there before.

    Raises OSError when it cannot be written, and whatever `lines` raises.
    """
    beside = path.with_name(f"{path.name}.part")
    try:
        with beside.open("w", encoding="ascii", newline="\n") as stream:
            stream.writelines(f"{line}\n" for line in lines)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def _gunzip(content: bytes, path: Path) -> Unpacked:
    parts: list[bytes] = []
    room = MAX_BYTES
    # Members may follow one another, as `cat a.gz b.gz` leaves them; zeros may fill the end.
    while content.strip(b"\0"):
        member = zlib.decompressobj(_GZIP_WINDOW)
        try:
            parts.append(member.decompress(content, room))
        except zlib.error as error:
            raise RinexError(str(path), 0, f"the gzip packing is damaged ({error}); get the file again") from error
        room -= len(parts[-1])
        if room <= 0:
            raise RinexError(str(path), 0, f"it unpacks to more than {MAX_BYTES >> 30} GiB; split it")
        if not member.eof:
            return Unpacked(b"".join(parts), (FileIssue(str(path), 0, "the gzip packing is cut short"),))
        content = member.unused_data
    return Unpacked(b"".join(parts))


def _is_compact(content: bytes) -> bool:
    first = content[:200].split(b"\n", 1)[0].decode("ascii", errors="replace")
    return first[LABEL_AT:].strip() == COMPACT_VERSION


def _unpack(content: bytes, path: Path) -> Unpacked:
    """What the library unpacks; what it says about epochs that it had to skip become issues."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            plain = hatanaka.decompress(content, skip_strange_epochs=True)
        except _UNPACKING_ERRORS as error:
            raise RinexError(str(path), 0, f"it cannot be unpacked ({error}); get the file again") from error
    return Unpacked(plain, tuple(FileIssue(str(path), 0, " ".join(str(warning.message).split())) for warning in said))
