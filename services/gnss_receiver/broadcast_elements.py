"""What satellites broadcast, by the names of the interface documents, made into ephemerides.

One way for everything that comes in bits (RTCM 3, subframes, pages, strings): it takes the place of
a record of a RINEX file (RINEX 3.05, tables A6 to A14), so that the same broadcast gives the same
ephemeris whichever way it came.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, timedelta
from typing import Final

from schemas.gnss import Ephemeris
from schemas.gnss_time import WEEK_S
from services.gnss_receiver.ephemeris_record import ephemeris_of
from services.gnss_receiver.rinex_navigation_records import NavigationRecord

_LINES: Final = """
    af0 af1 af2
    issue crs delta_n m0
    cuc e cus sqrt_a
    toe cic omega0 cis
    i0 crc omega omega_dot
    i_dot source week flag
    accuracy health delay_a delay_b
    sent fit_or_clock_issue
"""
KEPLER_ORDER: Final = tuple(_LINES.split())
"""Places of the figures in a record. Angles in radians, times in seconds, accuracy in metres."""
SEMICIRCLES: Final = frozenset({"delta_n", "m0", "omega0", "i0", "omega", "omega_dot", "i_dot"})
"""Broadcast as parts of pi."""
GALILEO_INAV: Final = 517.0
"""Data sources E1-B and E5b-I, clock for E5b and E1 (RINEX 3.05, table A8)."""
GALILEO_FNAV: Final = 258.0
"""Data source E5a-I, clock for E5a and E1."""
GST_FIRST_WEEK: Final = 1024
"""GPS week of Galileo's week 0, whose weeks count modulo GST_WEEKS (Galileo OS SIS ICD 2.1, 5.1.2)."""
GST_WEEKS: Final = 4096
_EPOCH = datetime(1980, 1, 6)  # noqa: DTZ001 - the scale is the satellite system's own
_DAY_S: Final = 86_400
_URA_M: Final = (2.0, 2.8, 4.0, 5.7, 8.0, 11.3, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0, 1024.0, 2048.0, 4096.0)
"""IS-GPS-200N, 20.3.3.3.1.3; BeiDou and QZSS alike."""
_NO_URA_M: Final = 8192.0
_SISA_STEPS: Final = ((50, 0.0, 0.01), (75, 0.5, 0.02), (100, 1.0, 0.04), (126, 2.0, 0.16))
"""Galileo OS SIS ICD 2.1, 5.1.12: below this index, from this figure, in steps of this."""
_NO_SISA_M: Final = -1.0


def ura_m(index: int) -> float:
    """User range accuracy [m] of its index; 8192 for `use at own risk`.

    >>> ura_m(3)
    5.7
    """
    return _URA_M[index] if index < len(_URA_M) else _NO_URA_M


def ura_index(accuracy_m: float | None) -> int:
    """Lowest index whose accuracy is no better than `accuracy_m`; 15 when unknown."""
    if accuracy_m is None:
        return len(_URA_M)
    return next((index for index, step_m in enumerate(_URA_M) if accuracy_m <= step_m), len(_URA_M))


def sisa_m(index: int) -> float:
    """Galileo's signal-in-space accuracy [m] of its index; -1 when none is predicted.

    >>> sisa_m(107)
    3.12
    """
    below = 0
    for limit, base_m, step_m in _SISA_STEPS:
        if index < limit:
            return round(base_m + (index - below) * step_m, 2)
        below = limit
    return _NO_SISA_M


def sisa_index(accuracy_m: float | None) -> int:
    """Lowest index whose accuracy is no better than `accuracy_m`; 255, none predicted, when unknown."""
    if accuracy_m is None:
        return 255
    return next((index for index in range(_SISA_STEPS[-1][0]) if accuracy_m <= sisa_m(index)), 255)


def full_week(week: int, weeks: int, near_week: int) -> int:
    """Week, counted continuously, of a week number that counts modulo `weeks`; the one nearest to `near_week`.

    >>> full_week(214, 1024, 2262)
    2262
    """
    return week + weeks * round((near_week - week) / weeks)


def reference_week(week: int, of_week_s: float, near_s: float) -> int:
    """Week in which a reference time lies: the transmitted one, or the one beside it at the end of a week.

    The week in a message is that of its transmission; around the end of a week the reference time
    may lie in the other one. It does when that is within half a week of `near_s` and the transmitted
    one is not. Times count from the first week's start.
    """
    beside = week + 1 if of_week_s < _DAY_S else week - 1 if of_week_s > WEEK_S - _DAY_S else week
    distances_s = [abs(one * WEEK_S + of_week_s - near_s) for one in (week, beside)]
    return beside if distances_s[1] < WEEK_S / 2 < distances_s[0] else week


def kepler_ephemeris(system: str, number: int, week: int, toc_s: float, named: Mapping[str, float]) -> Ephemeris:
    """Ephemeris of Keplerian elements by the names of KEPLER_ORDER, on the system's own time scale.

    `toc_s` counts within the `week` of `toe`, which may be another week's number by one turn. Raises
    ValueError, which says what is missing or cannot be.
    """
    toe_s = named["toe"]
    turns = round((toe_s - toc_s) / WEEK_S)
    moment = _EPOCH + timedelta(seconds=round(week * WEEK_S + toc_s + turns * WEEK_S))
    record = NavigationRecord(
        line=0,
        system=system,
        number=number,
        calendar=(moment.year, moment.month, moment.day, moment.hour, moment.minute, float(moment.second)),
        values=tuple({**named, "week": week}.get(name) for name in KEPLER_ORDER),
        times_within_week=True,
    )
    return ephemeris_of(record)


def glonass_ephemeris(number: int, utc_s: float, figures: Mapping[str, float]) -> Ephemeris:
    """Ephemeris of a GLONASS state; `utc_s` is its reference time in UTC, counted from the GPS epoch without leaps.

    Figures: tau_n and gamma_n as broadcast, sent (UTC, seconds of the week), health, channel, and x, y, z
    with _km, _kmps, _kmps2. Raises ValueError, which says what is missing or cannot be.
    """
    moment = _EPOCH + timedelta(seconds=round(utc_s))
    axes = [(figures[f"{axis}_km"], figures[f"{axis}_kmps"], figures[f"{axis}_kmps2"]) for axis in "xyz"]
    last = (figures["health"], figures["channel"], 0.0)
    record = NavigationRecord(
        line=0,
        system="R",
        number=number,
        calendar=(moment.year, moment.month, moment.day, moment.hour, moment.minute, float(moment.second)),
        values=(
            -figures["tau_n"],
            figures["gamma_n"],
            figures["sent"],
            *(figure for axis, extra in zip(axes, last, strict=True) for figure in (*axis, extra)),
        ),
        times_within_week=True,
    )
    return ephemeris_of(record)
