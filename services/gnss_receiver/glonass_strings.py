"""The immediate part of GLONASS's message: strings 1 to 4.

Source: GLONASS ICD 5.1, 4.4 (tables 4.5 to 4.7, 4.13).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from schemas.gnss import Ephemeris
from schemas.gnss_time import GPS_EPOCH_UNIX_S, WEEK_S, leap_seconds
from services.gnss_receiver.bit_fields import BitReader
from services.gnss_receiver.broadcast_elements import glonass_ephemeris
from services.gnss_receiver.rtcm_time import DAY_MS, MOSCOW_MS, nearest

WORDS: Final = 4
_BITS: Final = 85
_CHECKS: Final = 8
_TB_S: Final = 900
_DAY_S: Final = DAY_MS // 1000
_MOSCOW_S: Final = MOSCOW_MS // 1000
_PARTS: Final = (1, 2, 3, 4)
_FRAME_S: Final = 30.0
"""Strings of one ephemeris come within one frame."""

Figures = dict[str, float]


def _positions() -> tuple[int, ...]:
    """Place of each data bit in the Hamming code: all whole numbers but the powers of two."""
    return tuple(place for place in range(3, 128) if place & (place - 1))[: _BITS - _CHECKS]


_POSITIONS: Final = _positions()


def check_holds(string: int) -> bool:
    """Whether a string of 85 bits, the last sent lowest, fulfils its Hamming code and its parity.

    The lowest eight bits are the checks; bit 9 of the document has place 3 of the code, bit 10 place
    5, and so on over the places that are no power of two.
    """
    syndrome = 0
    for index, place in enumerate(_POSITIONS):
        if string >> (index + _CHECKS) & 1:
            syndrome ^= place
    return syndrome == string & 0x7F and not string.bit_count() & 1


class GlonassCollector:
    """Puts strings together, satellite by satellite."""

    def __init__(self) -> None:
        """Hold nothing yet."""
        self._parts: dict[int, dict[int, tuple[float, Figures]]] = {}

    def add(self, number: int, channel: int, words: Sequence[int], near_s: float) -> Ephemeris | None:
        """Ephemeris that a string completes; `near_s` counts from the GPS epoch, within half a day.

        `words` are four of 32 bits, the string's first bit highest. Raises ValueError for a wrong check
        or for figures that cannot be.
        """
        whole = 0
        for word in words[:WORDS]:
            whole = whole << 32 | word
        string = whole >> (32 * WORDS - _BITS)
        if len(words) < WORDS or not check_holds(string):
            msg = "the check of a string is wrong"
            raise ValueError(msg)
        reader = BitReader(string.to_bytes(-(-_BITS // 8), "big"))
        reader.uint(3 + 1)
        kind = reader.uint(4)
        parts = self._parts.setdefault(number, {})
        if kind not in _READERS:
            return None
        parts[kind] = near_s, _READERS[kind](reader)
        if kind != _PARTS[-1] or any(part not in parts or near_s - parts[part][0] > _FRAME_S for part in _PARTS):
            return None
        named: Figures = {"channel": float(channel)}
        for _, figures in parts.values():
            named |= figures
        parts.clear()
        utc_s = near_s - leap_seconds(near_s + GPS_EPOCH_UNIX_S)
        tb_utc_s = nearest(int(named["tb"]) * _TB_S - _MOSCOW_S, _DAY_S, int(utc_s))
        sent_s = nearest(int(named["tk"]) - _MOSCOW_S, _DAY_S, tb_utc_s)
        return glonass_ephemeris(number, float(tb_utc_s), named | {"sent": float(sent_s % WEEK_S)})


def _axis(reader: BitReader, name: str) -> Figures:
    return {
        f"{name}_kmps": reader.magnitude(24) * 2.0**-20,
        f"{name}_kmps2": reader.magnitude(5) * 2.0**-30,
        f"{name}_km": reader.magnitude(27) * 2.0**-11,
    }


def _read_1(reader: BitReader) -> Figures:
    reader.uint(4)
    tk_s = reader.uint(5) * 3600 + reader.uint(6) * 60 + reader.uint(1) * 30
    return {"tk": tk_s} | _axis(reader, "x")


def _read_2(reader: BitReader) -> Figures:
    health = reader.uint(3) >> 2
    reader.uint(1)
    tb = reader.uint(7)
    reader.uint(5)
    return {"health": health, "tb": tb} | _axis(reader, "y")


def _read_3(reader: BitReader) -> Figures:
    reader.uint(1)
    gamma = reader.magnitude(11) * 2.0**-40
    reader.uint(4)
    return {"gamma_n": gamma} | _axis(reader, "z")


def _read_4(reader: BitReader) -> Figures:
    return {"tau_n": reader.magnitude(22) * 2.0**-30}


_READERS: Final = {1: _read_1, 2: _read_2, 3: _read_3, 4: _read_4}
