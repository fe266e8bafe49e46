"""The D2 message of BeiDou's geostationary satellites: the ten pages of subframe 1.

The orbit runs through the pages without regard to their ends: page 3 holds the first figures of the clock,
a figure cut by the end of a page goes on in the next one.

Source: BDS-SIS-ICD-B1I 3.0, 5.3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from schemas.gnss import Ephemeris
from services.gnss_receiver.beidou_subframes import (
    BDT_BEHIND_S,
    BDT_FIRST_WEEK,
    TGD_S,
    WORDS,
    Figures,
    check_holds,
    information,
)
from services.gnss_receiver.bit_fields import BitReader, BitWriter
from services.gnss_receiver.broadcast_elements import kepler_ephemeris, reference_week, ura_m

PAGES: Final = 10
FRAME_S: Final = 3
"""From one page of subframe 1 to the next."""
ORBIT_BITS: Final = {3: (38, 28), 4: (0, 64), 5: (0, 64), 6: (0, 64), 7: (0, 64), 8: (0, 66), 9: (0, 64), 10: (0, 19)}
"""Where in a page, behind its number, the clock and the orbit stand: reserved bits before, and bits."""
_SUBFRAME: Final = 1


class BeidouGeoCollector:
    """Puts pages together, satellite by satellite."""

    def __init__(self) -> None:
        """Hold nothing yet."""
        self._pages: dict[int, dict[int, tuple[int, BitReader]]] = {}

    def add(self, number: int, words: Sequence[int], near_s: float) -> Ephemeris | None:
        """Ephemeris that a page completes; `near_s` counts from the GPS epoch.

        The orbit bears no issue that every page repeats, so only pages sent one after the other make one.
        Raises ValueError for a wrong check or for figures that cannot be.
        """
        if len(words) != WORDS or not check_holds(words):
            msg = "the check of a subframe is wrong"
            raise ValueError(msg)
        reader = BitReader(information(words))
        reader.uint(15)
        kind, sent_s, page = reader.uint(3), reader.uint(20), reader.uint(4)
        if kind != _SUBFRAME or not 1 <= page <= PAGES:
            return None
        pages = self._pages.setdefault(number, {})
        pages[page] = sent_s, reader
        start_s = sent_s - FRAME_S * (page - 1)
        if any(one not in pages or pages[one][0] != start_s + FRAME_S * (one - 1) for one in (1, *ORBIT_BITS)):
            return None
        named = _read_head(pages[1][1]) | _read_orbit(_joined({one: pages[one][1] for one in ORBIT_BITS}))
        pages.clear()
        named["sent"] = float(start_s)
        week = reference_week(int(named["week"]) + BDT_FIRST_WEEK, named["toe"], near_s - BDT_BEHIND_S)
        return kepler_ephemeris("C", number, week, named["toc"], named)


def _joined(pages: Mapping[int, BitReader]) -> BitReader:
    """Clock and orbit out of their pages, as one row of bits."""
    writer = BitWriter()
    for page, (reserved, width) in ORBIT_BITS.items():
        pages[page].uint(reserved)
        writer.uint(pages[page].uint(width), width)
    return BitReader(writer.content(), writer.length)


def _read_head(reader: BitReader) -> Figures:
    """Page 1: health, accuracy, week, delays."""
    health, clock_issue, accuracy = reader.uint(1), reader.uint(5), ura_m(reader.uint(4))
    week, toc_s = reader.uint(13), reader.uint(17) * 8.0
    figures: Figures = {"health": health, "fit_or_clock_issue": clock_issue, "accuracy": accuracy, "week": week}
    return figures | {"toc": toc_s, "delay_a": reader.sint(10) * TGD_S, "delay_b": reader.sint(10) * TGD_S}


def _read_orbit(reader: BitReader) -> Figures:
    clock = {"af0": reader.sint(24) * 2.0**-33, "af1": reader.sint(22) * 2.0**-50, "af2": reader.sint(11) * 2.0**-66}
    return clock | {
        "issue": reader.uint(5),
        "delta_n": reader.sint(16) * 2.0**-43 * math.pi,
        "cuc": reader.sint(18) * 2.0**-31,
        "m0": reader.sint(32) * 2.0**-31 * math.pi,
        "cus": reader.sint(18) * 2.0**-31,
        "e": reader.uint(32) * 2.0**-33,
        "sqrt_a": reader.uint(32) * 2.0**-19,
        "cic": reader.sint(18) * 2.0**-31,
        "cis": reader.sint(18) * 2.0**-31,
        "toe": reader.uint(17) * 8.0,
        "i0": reader.sint(32) * 2.0**-31 * math.pi,
        "crc": reader.sint(18) * 2.0**-6,
        "crs": reader.sint(18) * 2.0**-6,
        "omega_dot": reader.sint(24) * 2.0**-43 * math.pi,
        "omega0": reader.sint(32) * 2.0**-31 * math.pi,
        "omega": reader.sint(32) * 2.0**-31 * math.pi,
        "i_dot": reader.sint(14) * 2.0**-43 * math.pi,
    }
