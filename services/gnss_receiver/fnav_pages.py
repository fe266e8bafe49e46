"""The F/NAV message of Galileo (E5a-I): page types 1 to 4.

Source: Galileo OS SIS ICD 2.1, 4.2 and 5.1.
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
    GALILEO_FNAV,
    GST_FIRST_WEEK,
    GST_WEEKS,
    full_week,
    kepler_ephemeris,
    reference_week,
    sisa_m,
)
from services.gnss_receiver.crc24q import crc24q_of_bits

WORDS: Final = 8
"""A page of 244 bits in words of 32 bits."""
_DATA_BITS, _CHECK_BITS = 214, 24
_PARTS: Final = (1, 2, 3, 4)

Figures = dict[str, float]


@dataclass(slots=True)
class _Parts:
    """Latest pages of one satellite, each with its issue."""

    pages: dict[int, tuple[int, Figures]] = field(default_factory=dict)
    given: Figures | None = None


def page_bits(words: Sequence[int]) -> bytes:
    """The 214 bits of a page in front of its check. Raises ValueError where the check is wrong."""
    whole = int.from_bytes(b"".join(word.to_bytes(4, "big") for word in words[:WORDS]), "big")
    behind = 32 * WORDS - _DATA_BITS
    data = whole >> behind
    if crc24q_of_bits(data, _DATA_BITS) != whole >> (behind - _CHECK_BITS) & 0xFFFFFF:
        msg = "the check of a page is wrong"
        raise ValueError(msg)
    return (data << (-_DATA_BITS % 8)).to_bytes(-(-_DATA_BITS // 8), "big")


class FnavCollector:
    """Puts pages together, satellite by satellite."""

    def __init__(self) -> None:
        """Hold nothing yet."""
        self._parts: dict[int, _Parts] = {}

    def add(self, number: int, words: Sequence[int], near_s: float) -> Ephemeris | None:
        """Ephemeris that a page completes, new or with another health; `near_s` counts from the GPS epoch.

        Raises ValueError for a wrong check or for figures that cannot be.
        """
        if len(words) < WORDS:
            msg = f"a page of {len(words)} words is cut short"
            raise ValueError(msg)
        reader = BitReader(page_bits(words))
        kind = reader.uint(6)
        if kind not in _READERS:
            return None
        parts = self._parts.setdefault(number, _Parts())
        parts.pages[kind] = _READERS[kind](reader)
        if any(part not in parts.pages for part in _PARTS) or len({issue for issue, _ in parts.pages.values()}) > 1:
            return None
        named: Figures = {"source": GALILEO_FNAV, "issue": parts.pages[1][0]}
        for _, figures in parts.pages.values():
            named |= figures
        lasting = {name: value for name, value in named.items() if name not in ("week", "sent")}
        if lasting == parts.given:
            return None
        week = full_week(int(named["week"]) + GST_FIRST_WEEK, GST_WEEKS, int(near_s // WEEK_S))
        week = reference_week(week, named["toe"], near_s)
        ephemeris = kepler_ephemeris("E", number, week, named["toc"], named)
        parts.given = lasting
        return ephemeris


def _read_1(reader: BitReader) -> tuple[int, Figures]:
    reader.uint(6)
    issue = reader.uint(10)
    clock = {"toc": reader.uint(14) * 60.0, "af0": reader.sint(31) * 2.0**-34}
    clock |= {"af1": reader.sint(21) * 2.0**-46, "af2": reader.sint(6) * 2.0**-59}
    accuracy = sisa_m(reader.uint(8))
    # The ionosphere of NeQuick, and its regions.
    reader.uint(11 + 11 + 14 + 5)
    delay_s, health = reader.sint(10) * 2.0**-32, reader.uint(2) << 4
    week, sent_s = reader.uint(12), float(reader.uint(20))
    health |= reader.uint(1) << 3
    figures = {"accuracy": accuracy, "delay_a": delay_s, "health": health, "week": week, "sent": sent_s}
    return issue, clock | figures


def _read_2(reader: BitReader) -> tuple[int, Figures]:
    return reader.uint(10), {
        "m0": reader.sint(32) * 2.0**-31 * math.pi,
        "omega_dot": reader.sint(24) * 2.0**-43 * math.pi,
        "e": reader.uint(32) * 2.0**-33,
        "sqrt_a": reader.uint(32) * 2.0**-19,
        "omega0": reader.sint(32) * 2.0**-31 * math.pi,
        "i_dot": reader.sint(14) * 2.0**-43 * math.pi,
    }


def _read_3(reader: BitReader) -> tuple[int, Figures]:
    return reader.uint(10), {
        "i0": reader.sint(32) * 2.0**-31 * math.pi,
        "omega": reader.sint(32) * 2.0**-31 * math.pi,
        "delta_n": reader.sint(16) * 2.0**-43 * math.pi,
        "cuc": reader.sint(16) * 2.0**-29,
        "cus": reader.sint(16) * 2.0**-29,
        "crc": reader.sint(16) * 2.0**-5,
        "crs": reader.sint(16) * 2.0**-5,
        "toe": reader.uint(14) * 60.0,
    }


def _read_4(reader: BitReader) -> tuple[int, Figures]:
    return reader.uint(10), {"cic": reader.sint(16) * 2.0**-29, "cis": reader.sint(16) * 2.0**-29}


_READERS: Final = {1: _read_1, 2: _read_2, 3: _read_3, 4: _read_4}
