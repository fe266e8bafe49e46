"""Frames of RTCM 3, UBX and NMEA 0183 out of one stream of bytes, however it is cut and whatever stands between.

Receivers mix protocols on one port, so one reader finds them all. A frame counts only with a
right check; after a wrong one the search goes on from the next byte, so that a frame hidden
behind a damaged one is found.

Sources: RTCM 10403.3, 4.2; u-blox F9 interface description, 3.2 and 3.4; NMEA 0183, 5.3.
"""

from __future__ import annotations

import re
from collections import Counter
from itertools import accumulate
from typing import Final, Literal, NamedTuple

from services.gnss_receiver.crc24q import crc24q

Protocol = Literal["rtcm3", "ubx", "nmea"]

_START: Final = re.compile(rb"[\xd3\xb5$]")
_RTCM, _UBX, _NMEA = 0xD3, 0xB5, 0x24
_RTCM_AROUND: Final = 6
"""Preamble and length (3 bytes) before, check (3) after the message."""
_UBX_AROUND: Final = 8
"""Two marks, class, identity and length (2) before, check (2) after the message."""
_UBX_LONGEST: Final = 16 + 32 * 255
"""RXM-RAWX with all that it can count; what claims to be longer is no frame."""
_NMEA_LONGEST: Final = 256
"""The standard allows 82; receivers send longer ones."""
_NMEA_WHOLE: Final = re.compile(rb"\$([ !-)+-~]+)\*([0-9A-Fa-f]{2})\r?\n")
_NMEA_BEGUN: Final = re.compile(rb"\$[ -~]*\r?")


class Frame(NamedTuple):
    """One message that passed its check."""

    protocol: Protocol
    content: bytes
    """RTCM: the message; UBX: class, identity, then the message; NMEA: what stands between `$` and `*`."""


class _Look(NamedTuple):
    """What stands at a possible start: a frame, a reason to go on one byte later, or too little to tell."""

    frame: Frame | None
    length: int
    """Bytes to go on; 0 while too few are there."""
    error: str = ""
    """Counter of a frame that fails its check; empty where nothing speaks for a frame."""


_MORE: Final = _Look(None, 0)
_NOTHING: Final = _Look(None, 1)


def ubx_checksum(content: bytes) -> bytes:
    """Two check bytes over class, identity, length and message (Fletcher's sums modulo 256).

    >>> ubx_checksum(bytes([0x06, 0x00, 0x00, 0x00])).hex()
    '0618'
    """
    return bytes((sum(content) & 0xFF, sum(accumulate(content)) & 0xFF))


def nmea_checksum(content: bytes) -> int:
    """Exclusive or of everything between `$` and `*`.

    >>> f"{nmea_checksum(b'GPGLL,5300.97914,N,00259.98174,E,125926,A'):02X}"
    '28'
    """
    check = 0
    for byte in content:
        check ^= byte
    return check


def _rtcm(buffer: bytes, at: int) -> _Look:
    if at + 3 > len(buffer):
        return _MORE
    if buffer[at + 1] & 0xFC:
        return _NOTHING  # six reserved bits, zero in every version
    length = (buffer[at + 1] & 3) << 8 | buffer[at + 2]
    stop = at + length + _RTCM_AROUND
    if stop > len(buffer):
        return _MORE
    if crc24q(buffer[at:stop]):
        return _Look(None, 1, "rtcm3_crc_errors")
    return _Look(Frame("rtcm3", buffer[at + 3 : stop - 3]), stop - at)


def _ubx(buffer: bytes, at: int) -> _Look:
    if at + 6 > len(buffer):
        return _MORE if b"\xb5\x62".startswith(buffer[at : at + 2]) else _NOTHING
    length = int.from_bytes(buffer[at + 4 : at + 6], "little")
    if buffer[at + 1] != 0x62 or length > _UBX_LONGEST:  # noqa: PLR2004 - the second mark
        return _NOTHING
    stop = at + length + _UBX_AROUND
    if stop > len(buffer):
        return _MORE
    if ubx_checksum(buffer[at + 2 : stop - 2]) != buffer[stop - 2 : stop]:
        return _Look(None, 1, "ubx_checksum_errors")
    return _Look(Frame("ubx", buffer[at + 2 : at + 4] + buffer[at + 6 : stop - 2]), stop - at)


def _nmea(buffer: bytes, at: int) -> _Look:
    whole = _NMEA_WHOLE.match(buffer, at, at + _NMEA_LONGEST)
    if whole is None:
        begun = _NMEA_BEGUN.match(buffer, at, at + _NMEA_LONGEST)
        open_end = begun is not None and begun.end() == len(buffer) and len(buffer) - at < _NMEA_LONGEST
        return _MORE if open_end else _NOTHING
    if nmea_checksum(whole[1]) != int(whole[2], 16):
        return _Look(None, 1, "nmea_checksum_errors")
    return _Look(Frame("nmea", whole[1]), whole.end() - at)


class Framer:
    """Collects bytes and gives the frames in them."""

    def __init__(self) -> None:
        """Hold nothing yet."""
        self.counts: Counter[str] = Counter()
        """`bytes`, `bytes_skipped`, frames by protocol and failed checks by kind."""
        self._rest = b""

    def feed(self, chunk: bytes) -> list[Frame]:
        """Frames completed by `chunk`, in their order."""
        self.counts["bytes"] += len(chunk)
        buffer = self._rest + chunk
        frames: list[Frame] = []
        at = 0
        while at < len(buffer):
            start = _START.search(buffer, at)
            if start is None:
                self._skip(len(buffer) - at)
                at = len(buffer)
                break
            self._skip(start.start() - at)
            at = start.start()
            mark = buffer[at]
            look = _rtcm(buffer, at) if mark == _RTCM else _ubx(buffer, at) if mark == _UBX else _nmea(buffer, at)
            if not look.length:
                break
            if look.error:
                self.counts[look.error] += 1
            if look.frame is None:
                self._skip(look.length)
            else:
                frames.append(look.frame)
                self.counts[f"{look.frame.protocol}_frames"] += 1
            at += look.length
        self._rest = buffer[at:]
        return frames

    def cut(self) -> None:
        """Forget an unfinished frame: the connection ended, and what comes next does not continue it."""
        self._skip(len(self._rest))
        self._rest = b""

    def _skip(self, count: int) -> None:
        if count:
            self.counts["bytes_skipped"] += count
