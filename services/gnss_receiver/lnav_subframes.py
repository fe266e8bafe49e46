"""The legacy navigation message of GPS and QZSS: subframes 1 to 3 and the ionosphere in page 18 of subframe 4.

Sources: IS-GPS-200N, 20.3.3 and 20.3.5.2 (parity); IS-QZSS-PNT-006, 4.3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from schemas.gnss import Ephemeris, Ionosphere
from schemas.gnss_time import WEEK_S, unix_ns_from_gps
from services.gnss_receiver.bit_fields import BitReader
from services.gnss_receiver.broadcast_elements import full_week, kepler_ephemeris, reference_week, ura_m

WORDS: Final = 10
_DATA_BITS, _PARITY_BITS = 24, 6
_PARITY_MASKS: Final = (0x2EC7CD2, 0x1763E69, 0x2BB1F34, 0x15D8F9A, 0x1AEC7CD, 0x22DEA27)
"""Bits of (last two bits of the word before, 24 data bits) that make each parity bit (table 20-XIV)."""
_FIRST_WORD: Final = 24
_TOW_S: Final = 6
_IONOSPHERE_PAGE: Final = 56
_ALPHA_SCALES: Final = (2.0**-30, 2.0**-27, 2.0**-24, 2.0**-24)
_BETA_SCALES: Final = (2.0**11, 2.0**14, 2.0**16, 2.0**16)


def parity_holds(words: Sequence[int]) -> bool:
    """Whether the parity of every word is right.

    Each word has 32 bits: the last two of the word before, 24 of data, 6 of parity. Where the last
    bit before is set, satellites send the word inverted (IS-GPS-200N, 20.3.5.2); u-blox receivers
    turn it back as a whole, with its parity and the two bits in front, so that the same rule holds.
    """
    return all(word & 0x3F == _parity(word >> _PARITY_BITS) for word in words)


def _parity(data: int) -> int:
    parity = 0
    for mask in _PARITY_MASKS:
        parity = parity << 1 | (data & mask).bit_count() & 1
    return parity


@dataclass(slots=True)
class _Parts:
    """Figures of the latest subframes of one satellite, each with its issue."""

    clock: tuple[int, dict[str, float]] | None = None
    first: tuple[int, dict[str, float]] | None = None
    second: tuple[int, dict[str, float]] | None = None


class LnavCollector:
    """Puts subframes together, satellite by satellite; `system` is G or J."""

    def __init__(self, system: str) -> None:
        """Hold nothing yet."""
        self._system = system
        self._parts: dict[int, _Parts] = {}

    def add(self, number: int, words: Sequence[int], near_s: float) -> Ephemeris | Ionosphere | None:
        """Ephemeris or ionosphere that a subframe completes.

        `words` are ten, `near_s` is a time within some years, counted from the GPS epoch. Raises
        ValueError for a wrong parity or for figures that cannot be.
        """
        if len(words) != WORDS or not parity_holds(words):
            msg = "the parity of a subframe is wrong"
            raise ValueError(msg)
        bits = 0
        for word in words:
            bits = bits << _DATA_BITS | word >> _PARITY_BITS & 0xFFFFFF
        reader = BitReader(bits.to_bytes(WORDS * _DATA_BITS // 8, "big"))
        reader.uint(_FIRST_WORD)
        sent_s = reader.uint(17) * _TOW_S
        reader.uint(2)
        kind = reader.uint(3)
        reader.uint(2)
        parts = self._parts.setdefault(number, _Parts())
        match kind:
            case 1:
                parts.clock = _read_clock(reader, sent_s)
            case 2:
                parts.first = _read_first(reader)
            case 3:
                parts.second = _read_second(reader)
            case 4:
                return self._ionosphere(reader, sent_s, near_s)
            case _:
                return None
        return self._ephemeris(number, parts, near_s)

    def _ephemeris(self, number: int, parts: _Parts, near_s: float) -> Ephemeris | None:
        if parts.clock is None or parts.first is None or parts.second is None:
            return None
        if len({parts.clock[0] & 0xFF, parts.first[0], parts.second[0]}) > 1:
            return None
        named = parts.clock[1] | parts.first[1] | parts.second[1] | {"issue": parts.first[0]}
        week = full_week(int(named["week"]), 1024, int(near_s // WEEK_S))
        week = reference_week(week, named["toe"], near_s)
        self._parts[number] = _Parts()
        return kepler_ephemeris(self._system, number, week, named["toc"], named)

    def _ionosphere(self, reader: BitReader, sent_s: float, near_s: float) -> Ionosphere | None:
        reader.uint(2)
        if reader.uint(6) != _IONOSPHERE_PAGE:
            return None
        a = [reader.sint(8) * scale for scale in _ALPHA_SCALES]
        b = [reader.sint(8) * scale for scale in _BETA_SCALES]
        week = round((near_s - sent_s) / WEEK_S)
        t_ns = unix_ns_from_gps(week, sent_s)
        return Ionosphere(t_ns=t_ns, alpha=(a[0], a[1], a[2], a[3]), beta=(b[0], b[1], b[2], b[3]))


def _read_clock(reader: BitReader, sent_s: float) -> tuple[int, dict[str, float]]:
    week = reader.uint(10)
    reader.uint(2)
    accuracy, health, issue = ura_m(reader.uint(4)), reader.uint(6), reader.uint(2) << 8
    reader.uint(1 + 23 + 24 + 24 + 16)
    delay_s = reader.sint(8) * 2.0**-31
    issue |= reader.uint(8)
    figures: dict[str, float] = {"week": week, "accuracy": accuracy, "health": health, "delay_a": delay_s}
    figures |= {"toc": reader.uint(16) * 16.0, "af2": reader.sint(8) * 2.0**-55}
    figures |= {"af1": reader.sint(16) * 2.0**-43, "af0": reader.sint(22) * 2.0**-31, "sent": sent_s}
    return issue, figures


def _read_first(reader: BitReader) -> tuple[int, dict[str, float]]:
    issue = reader.uint(8)
    return issue, {
        "crs": reader.sint(16) * 2.0**-5,
        "delta_n": reader.sint(16) * 2.0**-43 * math.pi,
        "m0": reader.sint(32) * 2.0**-31 * math.pi,
        "cuc": reader.sint(16) * 2.0**-29,
        "e": reader.uint(32) * 2.0**-33,
        "cus": reader.sint(16) * 2.0**-29,
        "sqrt_a": reader.uint(32) * 2.0**-19,
        "toe": reader.uint(16) * 16.0,
        "fit_or_clock_issue": reader.uint(1),
    }


def _read_second(reader: BitReader) -> tuple[int, dict[str, float]]:
    figures = {
        "cic": reader.sint(16) * 2.0**-29,
        "omega0": reader.sint(32) * 2.0**-31 * math.pi,
        "cis": reader.sint(16) * 2.0**-29,
        "i0": reader.sint(32) * 2.0**-31 * math.pi,
        "crc": reader.sint(16) * 2.0**-5,
        "omega": reader.sint(32) * 2.0**-31 * math.pi,
        "omega_dot": reader.sint(24) * 2.0**-43 * math.pi,
    }
    issue = reader.uint(8)
    return issue, figures | {"i_dot": reader.sint(14) * 2.0**-43 * math.pi}
