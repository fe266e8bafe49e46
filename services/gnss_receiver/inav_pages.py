"""The I/NAV message of Galileo (E1-B, E5b-I): word types 1 to 5.

Source: Galileo OS SIS ICD 2.1, 4.3.2 to 4.3.5 and 5.1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from schemas.gnss import Ephemeris
from schemas.gnss_time import WEEK_S
from services.gnss_receiver.bit_fields import BitReader
from services.gnss_receiver.broadcast_elements import (
    GALILEO_INAV,
    GST_FIRST_WEEK,
    GST_WEEKS,
    full_week,
    kepler_ephemeris,
    reference_week,
    sisa_m,
)
from services.gnss_receiver.crc24q import crc24q_of_bits

WORDS: Final = 8
"""Two parts of a page, each in four words of 32 bits."""
_EVEN_BITS, _ODD_BITS, _CHECK_BITS = 114, 82, 24
_PART_BITS: Final = 128
_EVEN_DATA, _ODD_DATA = 112, 16
_PARTS: Final = (1, 2, 3, 4)
_LAST: Final = 5

Figures = dict[str, float]


@dataclass(slots=True)
class _Parts:
    """Latest words 1 to 4 of one satellite with their issue, and word 5, which has none."""

    words: dict[int, tuple[int, Figures]] = field(default_factory=dict)
    last: Figures | None = None
    given: tuple[int, Figures] | None = None


def page_word(words: Sequence[int]) -> bytes | None:
    """The 128 bits of data in a nominal page; None for an alert page.

    Raises ValueError for two parts that do not belong together, and for a wrong check.
    """
    parts = [int.from_bytes(b"".join(word.to_bytes(4, "big") for word in words[at : at + 4]), "big") for at in (0, 4)]
    even, odd = parts if not parts[0] >> (_PART_BITS - 1) else parts[::-1]
    if even >> (_PART_BITS - 1) or not odd >> (_PART_BITS - 1):
        msg = "the two parts of a page do not belong together"
        raise ValueError(msg)
    head = odd >> (_PART_BITS - _ODD_BITS)
    checked = even >> (_PART_BITS - _EVEN_BITS) << _ODD_BITS | head
    check = odd >> (_PART_BITS - _ODD_BITS - _CHECK_BITS) & 0xFFFFFF
    if crc24q_of_bits(checked, _EVEN_BITS + _ODD_BITS) != check:
        msg = "the check of a page is wrong"
        raise ValueError(msg)
    if even >> (_PART_BITS - 2) & 1:
        return None
    high = even >> (_PART_BITS - 2 - _EVEN_DATA) & ((1 << _EVEN_DATA) - 1)
    low = odd >> (_PART_BITS - 2 - _ODD_DATA) & ((1 << _ODD_DATA) - 1)
    return (high << _ODD_DATA | low).to_bytes((_EVEN_DATA + _ODD_DATA) // 8, "big")


class InavCollector:
    """Puts words together, satellite by satellite."""

    def __init__(self) -> None:
        """Hold nothing yet."""
        self._parts: dict[int, _Parts] = {}

    def add(self, number: int, words: Sequence[int], near_s: float) -> Ephemeris | None:
        """Ephemeris that a page completes, new or with another health; `near_s` counts from the GPS epoch.

        Raises ValueError for a wrong check or for figures that cannot be.
        """
        data = page_word(words) if len(words) >= WORDS else None
        if data is None:
            return None
        reader = BitReader(data)
        kind = reader.uint(6)
        parts = self._parts.setdefault(number, _Parts())
        if kind in _PARTS:
            issue = reader.uint(10)
            parts.words[kind] = issue, _READERS[kind](reader)
        elif kind == _LAST:
            parts.last = _read_last(reader)
        else:
            return None
        return self._ephemeris(number, parts, near_s)

    def _ephemeris(self, number: int, parts: _Parts, near_s: float) -> Ephemeris | None:
        if parts.last is None or len(parts.words) < len(_PARTS):
            return None
        issues = {issue for issue, _ in parts.words.values()}
        if len(issues) > 1:
            return None
        named: Figures = {"source": GALILEO_INAV, "issue": issues.pop()}
        for _, figures in parts.words.values():
            named |= figures
        lasting = {name: parts.last[name] for name in ("health", "delay_a", "delay_b")}
        now = int(named["issue"]), named | lasting
        if now == parts.given:
            return None
        week = full_week(int(parts.last["week"]) + GST_FIRST_WEEK, GST_WEEKS, int(near_s // WEEK_S))
        week = reference_week(week, named["toe"], near_s)
        ephemeris = kepler_ephemeris("E", number, week, named["toc"], named | parts.last)
        parts.given = now
        return ephemeris


def _read_1(reader: BitReader) -> Figures:
    return {
        "toe": reader.uint(14) * 60.0,
        "m0": reader.sint(32) * 2.0**-31 * math.pi,
        "e": reader.uint(32) * 2.0**-33,
        "sqrt_a": reader.uint(32) * 2.0**-19,
    }


def _read_2(reader: BitReader) -> Figures:
    return {
        "omega0": reader.sint(32) * 2.0**-31 * math.pi,
        "i0": reader.sint(32) * 2.0**-31 * math.pi,
        "omega": reader.sint(32) * 2.0**-31 * math.pi,
        "i_dot": reader.sint(14) * 2.0**-43 * math.pi,
    }


def _read_3(reader: BitReader) -> Figures:
    return {
        "omega_dot": reader.sint(24) * 2.0**-43 * math.pi,
        "delta_n": reader.sint(16) * 2.0**-43 * math.pi,
        "cuc": reader.sint(16) * 2.0**-29,
        "cus": reader.sint(16) * 2.0**-29,
        "crc": reader.sint(16) * 2.0**-5,
        "crs": reader.sint(16) * 2.0**-5,
        "accuracy": sisa_m(reader.uint(8)),
    }


def _read_4(reader: BitReader) -> Figures:
    reader.uint(6)
    return {
        "cic": reader.sint(16) * 2.0**-29,
        "cis": reader.sint(16) * 2.0**-29,
        "toc": reader.uint(14) * 60.0,
        "af0": reader.sint(31) * 2.0**-34,
        "af1": reader.sint(21) * 2.0**-46,
        "af2": reader.sint(6) * 2.0**-59,
    }


_READERS: Final = {1: _read_1, 2: _read_2, 3: _read_3, 4: _read_4}


def _read_last(reader: BitReader) -> Figures:
    reader.uint(11 + 11 + 14 + 5)
    delays = {"delay_a": reader.sint(10) * 2.0**-32, "delay_b": reader.sint(10) * 2.0**-32}
    health_e5b, health_e1 = reader.uint(2), reader.uint(2)
    valid_e5b, valid_e1 = reader.uint(1), reader.uint(1)
    health = valid_e1 | health_e1 << 1 | valid_e5b << 6 | health_e5b << 7
    return delays | {"health": health, "week": reader.uint(12), "sent": float(reader.uint(20))}
