"""Where the epochs of a RINEX observation file stand, and which satellites each announces.

An epoch runs from its own header line to the next. It is judged as a whole: RINEX 3 names the
satellite on every line, so what is there is kept and what is missing is reported; RINEX 2 lists
the satellites once, so that one line too many or too few would shift them all, and the epoch is
refused.
Source: RINEX 2.11, table A2; RINEX 3.05, table A3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schemas.gnss_time import WEEK_S, leap_seconds
from services.gnss_receiver.rinex_lines import BLANK, Bools, Ints, Lines, integers

_MARK = ord(">")
_POINT = ord(".")
_TICKS = 10_000_000
"""Epochs are written to 0.1 microseconds."""
_GPS_DAY_0 = 3657
"""1980-01-06 in days since 1970-01-01 (IS-GPS-200, 3.3.4)."""
_DAY_S = 86_400
_BDT_BEHIND_S = 14
"""GPS time minus BeiDou time (BDS-SIS-ICD-2.1, 3.3)."""
POWER_FAILURE, FIRST_EVENT, LAST_EVENT, CYCLE_SLIPS = 1, 2, 5, 6


@dataclass(frozen=True, slots=True)
class EpochHeads:
    """Every epoch header line, readable or not; columns of shape (n,)."""

    line: Ints
    """Index of the header line."""
    next_line: Ints
    """Index of the following header line, or the number of lines."""
    flag: Ints
    """-1 where it cannot be read."""
    count: Ints
    """Satellites, or records after an event; -1 where it cannot be read."""
    ticks: Ints
    """Time since the GPS epoch on the file's own time scale, in 0.1 microseconds; -1 where it cannot be read."""
    day: Ints
    """Calendar day since the GPS epoch; it tells 23:59:60 from the 0:00:00 after it."""


def find_heads(lines: Lines, *, rinex_3: bool) -> EpochHeads:
    """Epoch header lines among `lines` (header records and comments already left out)."""
    shift = 3 if rinex_3 else 0
    at = np.flatnonzero(lines.character(0) == _MARK if rinex_3 else _is_head_2(lines))
    text = lines.characters(at, 0, 35)
    next_line = np.append(at[1:], len(lines)).astype(np.int64)
    flag, flag_good = integers(text[:, 28 + shift : 29 + shift])
    count, count_good = integers(text[:, 29 + shift : 32 + shift])
    # An epoch flag may be left out with the count of an event record (RINEX 2.11: blank means 0).
    blank_flag = text[:, 28 + shift] == BLANK
    flag = np.where(flag_good | blank_flag, flag, -1)
    event = (flag >= FIRST_EVENT) & (flag <= LAST_EVENT)
    blank_count = (text[:, 29 + shift : 32 + shift] == BLANK).all(axis=1)
    count = np.where(count_good | (event & blank_count), count, -1)
    day, ticks = _times(text, rinex_3=rinex_3)
    return EpochHeads(at, next_line, flag, count, ticks, day)


def _is_head_2(lines: Lines) -> Bools:
    """RINEX 2 epoch headers, by the point of their seconds; or by a flag alone, for events without a time.

    An observation line cannot look like one: its columns 19 and 27 to 32 hold other things.
    """
    timed: Bools = (lines.character(18) == _POINT) & (lines.character(10) != _POINT) & (lines.character(0) == BLANK)
    flag = lines.character(28)
    suspect = np.flatnonzero(
        ~timed
        & (flag >= ord("2"))
        & (flag <= ord("6"))
        & (lines.character(26) == BLANK)
        & (lines.character(27) == BLANK)
    )
    untimed = suspect[(lines.characters(suspect, 0, 28) == BLANK).all(axis=1)]
    timed[untimed] = True
    return timed


def _times(text: NDArray[np.uint8], *, rinex_3: bool) -> tuple[Ints, Ints]:
    """Days and ticks since the GPS epoch; ticks are -1 where a part of the date or time is not one."""
    shift = 3 if rinex_3 else 0
    year, good = integers(text[:, 2:6] if rinex_3 else text[:, 1:3])
    if not rinex_3:
        # RINEX 2.11, 6.5: 80 to 99 are 1980 to 1999, 00 to 79 are 2000 to 2079.
        year = np.where(year >= 80, year + 1900, year + 2000)  # noqa: PLR2004
    parts = []
    for offset in (4, 7, 10, 13):
        part, part_good = integers(text[:, offset + shift - 1 : offset + shift + 2])
        parts.append(part)
        good &= part_good
    month, day, hour, minute = parts
    whole, whole_good = integers(text[:, 15 + shift : 18 + shift])
    fraction, fraction_good = integers(text[:, 19 + shift : 26 + shift])
    good &= whole_good & fraction_good & (text[:, 18 + shift] == _POINT)
    good &= (year >= 1980) & (month >= 1) & (month <= 12) & (day >= 1)  # noqa: PLR2004
    good &= (hour < 24) & (minute < 60) & (whole <= 60)  # noqa: PLR2004 - 60: leap second
    months = np.where(good, (year - 1970) * 12 + month - 1, 0).astype("datetime64[M]")
    first_day = months.astype("datetime64[D]").astype(np.int64)
    days_in_month = (months + 1).astype("datetime64[D]").astype(np.int64) - first_day
    good &= day <= days_in_month
    days = first_day + day - 1 - _GPS_DAY_0
    good &= days >= 0
    ticks = ((days * 24 + hour) * 60 + minute) * 60 * _TICKS + whole * _TICKS + fraction
    return days, np.where(good, ticks, -1)


def gps_times(ticks: Ints, day: Ints, time_system: str) -> tuple[Ints, NDArray[np.float64]]:
    """GPS weeks and times of week [s] of epochs on the time scale that a file names.

    GPS, Galileo, QZSS and NavIC time agree in RINEX; BeiDou time is 14 s behind; GLONASS time is UTC
    (RINEX 3.05, section 4.1).
    """
    if time_system == "BDT":
        ticks = ticks + _BDT_BEHIND_S * _TICKS
    elif time_system in {"GLO", "UTC"}:
        # Leap seconds change between days, never inside one.
        days, inverse = np.unique(day, return_inverse=True)
        ahead_s = [leap_seconds((each + _GPS_DAY_0) * _DAY_S) for each in days.tolist()]
        ticks = ticks + np.array(ahead_s, np.int64)[inverse] * _TICKS
    week, rest = np.divmod(ticks, WEEK_S * _TICKS)
    return week, rest / _TICKS
