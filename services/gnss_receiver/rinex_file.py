"""Bytes of a RINEX file on disk: read from whatever they are packed in, and written whole or not at all."""

from __future__ import annotations

import gzip
import warnings
import zlib
from collections.abc import Iterable
from pathlib import Path

import hatanaka

from services.gnss_receiver.rinex_error import RinexError
from services.gnss_receiver.rinex_header import COMPACT_VERSION, LABEL_AT

_GZIP, _LZW, _BZIP2, _ZIP = b"\x1f\x8b", b"\x1f\x9d", b"BZh", b"PK\x03\x04"


def read_bytes(path: Path) -> bytes:
    """Text of a RINEX file, unpacked: plain, gzip, compress (.Z), bzip2, zip or Hatanaka, by what it holds.

    Raises RinexError when the packing is damaged, OSError when the file cannot be read.
    """
    content = path.read_bytes()
    if content.startswith(_GZIP):
        try:
            content = gzip.decompress(content)
        except (OSError, EOFError, zlib.error) as error:
            raise RinexError(str(path), 0, f"the gzip packing is damaged ({error}); get the file again") from error
    if content.startswith((_LZW, _BZIP2, _ZIP)) or _is_compact(content):
        content = _unpack(content, path)
    return content


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


def _is_compact(content: bytes) -> bool:
    first = content[:200].split(b"\n", 1)[0].decode("ascii", errors="replace")
    return first[LABEL_AT:].strip() == COMPACT_VERSION


def _unpack(content: bytes, path: Path) -> bytes:
    with warnings.catch_warnings(record=True):
        try:
            return bytes(hatanaka.decompress(content))
        except (hatanaka.HatanakaException, ValueError, OSError, EOFError) as error:
            raise RinexError(str(path), 0, f"it cannot be unpacked ({error}); get the file again") from error
