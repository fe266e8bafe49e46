"""The D1 message of BeiDou's satellites in medium and inclined orbits: subframes 1 to 3.

Source: BDS-SIS-ICD-B1I 3.0, 5.1.3 (BCH code) and 5.2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from schemas.gnss import Ephemeris
from services.gnss_receiver.bit_fields import BitReader, BitWriter
from services.gnss_receiver.broadcast_elements import kepler_ephemeris, reference_week, ura_m

WORDS: Final = 10
_PREAMBLE: Final = 0b11100010010
BDT_FIRST_WEEK: Final = 1356
BDT_BEHIND_S: Final = 14
_SUBFRAME_S: Final = 6
TGD_S: Final = 1e-10
_GENERATOR: Final = 0b10011
_CODE_BITS, _CHECK_BITS = 15, 4
_TOE_LOW_BITS: Final = 15
_PARTS: Final = (1, 2, 3)

Figures = dict[str, float]


def _remainder(code: int) -> int:
    """Remainder of a code word of 15 bits by the generator x^4 + x + 1."""
    for bit in range(_CODE_BITS - 1, _CHECK_BITS - 1, -1):
        if code >> bit & 1:
            code ^= _GENERATOR << (bit - _CHECK_BITS)
    return code


def check_holds(words: Sequence[int]) -> bool:
    """Whether the first word begins with the preamble and the code words in all of them are right.

    Words have 30 bits. As sent, two code words of 15 bits alternate in them; here they stand as
    receivers give them, 11 and 11 bits of information, then 4 and 4 of check. The first word has
    one code word, at its end.
    """
    first, *others = words
    if first >> 19 & 0x7FF != _PREAMBLE or _remainder(first & 0x7FFF):
        return False
    high = ((word >> 19 & 0x7FF) << 4 | word >> 4 & 0xF for word in others)
    low = ((word >> 8 & 0x7FF) << 4 | word & 0xF for word in others)
    return not any(_remainder(code) for code in (*high, *low))


def information(words: Sequence[int]) -> bytes:
    """The 224 bits of a subframe without its checks."""
    writer = BitWriter()
    writer.uint(words[0] >> 4 & 0x3FFFFFF, 26)
    for word in words[1:]:
        writer.uint(word >> 8 & 0x3FFFFF, 22)
    return writer.content()


class BeidouCollector:
    """Puts subframes together, satellite by satellite."""

    def __init__(self) -> None:
        """Hold nothing yet."""
        self._parts: dict[int, dict[int, tuple[int, Figures]]] = {}

    def add(self, number: int, words: Sequence[int], near_s: float) -> Ephemeris | None:
        """Ephemeris that a subframe completes; `near_s` counts from the GPS epoch.

        The orbit bears no issue, so only subframes sent one after the other make one. Raises
        ValueError for a wrong check or for figures that cannot be.
        """
        if len(words) != WORDS or not check_holds(words):
            msg = "the check of a subframe is wrong"
            raise ValueError(msg)
        reader = BitReader(information(words))
        reader.uint(15)
        kind, sent_s = reader.uint(3), reader.uint(20)
        if kind not in _READERS:
            return None
        parts = self._parts.setdefault(number, {})
        parts[kind] = sent_s, _READERS[kind](reader)
        start_s = sent_s - _SUBFRAME_S * (kind - 1)
        if any(part not in parts or parts[part][0] != start_s + _SUBFRAME_S * (part - 1) for part in _PARTS):
            return None
        named: Figures = {"sent": float(start_s)}
        for _, figures in parts.values():
            named |= figures
        named["toe"] = 8.0 * (int(named["toe_high"]) << _TOE_LOW_BITS | int(named["toe_low"]))
        parts.clear()
        week = reference_week(int(named["week"]) + BDT_FIRST_WEEK, named["toe"], near_s - BDT_BEHIND_S)
        return kepler_ephemeris("C", number, week, named["toc"], named)


def _read_1(reader: BitReader) -> Figures:
    health, clock_issue, accuracy = reader.uint(1), reader.uint(5), ura_m(reader.uint(4))
    week, toc_s = reader.uint(13), reader.uint(17) * 8.0
    delays = {"delay_a": reader.sint(10) * TGD_S, "delay_b": reader.sint(10) * TGD_S}
    reader.uint(64)
    clock = {"af2": reader.sint(11) * 2.0**-66, "af0": reader.sint(24) * 2.0**-33, "af1": reader.sint(22) * 2.0**-50}
    figures: Figures = {"health": health, "fit_or_clock_issue": clock_issue, "accuracy": accuracy, "week": week}
    return figures | delays | clock | {"toc": toc_s, "issue": reader.uint(5)}


def _read_2(reader: BitReader) -> Figures:
    return {
        "delta_n": reader.sint(16) * 2.0**-43 * math.pi,
        "cuc": reader.sint(18) * 2.0**-31,
        "m0": reader.sint(32) * 2.0**-31 * math.pi,
        "e": reader.uint(32) * 2.0**-33,
        "cus": reader.sint(18) * 2.0**-31,
        "crc": reader.sint(18) * 2.0**-6,
        "crs": reader.sint(18) * 2.0**-6,
        "sqrt_a": reader.uint(32) * 2.0**-19,
        "toe_high": reader.uint(2),
    }


def _read_3(reader: BitReader) -> Figures:
    return {
        "toe_low": reader.uint(15),
        "i0": reader.sint(32) * 2.0**-31 * math.pi,
        "cic": reader.sint(18) * 2.0**-31,
        "omega_dot": reader.sint(24) * 2.0**-43 * math.pi,
        "cis": reader.sint(18) * 2.0**-31,
        "i_dot": reader.sint(14) * 2.0**-43 * math.pi,
        "omega0": reader.sint(32) * 2.0**-31 * math.pi,
        "omega": reader.sint(32) * 2.0**-31 * math.pi,
    }


_READERS: Final = {1: _read_1, 2: _read_2, 3: _read_3}
