"""Times in RTCM 3 messages, which name no week or no day, made whole with the help of a time nearby.

GPS times are whole milliseconds since the GPS epoch. Sources: RTCM 10403.3, DF004, DF034, DF248,
DF416, DF427 and DF428; BDS-SIS-ICD-B1I 3.0, 3.3.
"""

from __future__ import annotations

from typing import Final

from schemas.gnss_time import GPS_EPOCH_UNIX_S, NS, WEEK_S, gps_from_unix_ns, leap_seconds, unix_ns_from_gps

WEEK_MS: Final = 1000 * WEEK_S
DAY_MS: Final = 86_400_000
BDT_BEHIND_MS: Final = 14_000
"""GPS time minus BeiDou time."""
MOSCOW_MS: Final = 3 * 3_600_000
"""GLONASS time is UTC and three hours."""
_DAY_BITS: Final = 27
_NO_DAY: Final = 7
_LONGEST_DAY_MS: Final = DAY_MS + 1000
"""A day with a leap second."""
_MJD_OF_UNIX: Final = 40_587


def gps_ms_from_unix_ns(t_ns: int) -> int:
    """GPS time of a UTC time, to the nearest millisecond."""
    week, tow_s = gps_from_unix_ns(t_ns)
    return week * WEEK_MS + round(1000.0 * tow_s)


def unix_ns_from_gps_ms(gps_ms: int) -> int:
    """UTC of a GPS time."""
    week, tow_ms = divmod(gps_ms, WEEK_MS)
    return unix_ns_from_gps(week, tow_ms / 1000.0)


def nearest(within: int, period: int, near: int) -> int:
    """The number that lies `within` its period, of the period that brings it nearest to `near`.

    >>> nearest(10, 100, 295)
    310
    """
    return within + period * ((near - within + period // 2) // period)


def epoch_gps_ms(system: str, field: int, near_gps_ms: int) -> int:
    """GPS time of the epoch field of a Multiple Signal Message, the one nearest to `near_gps_ms`.

    Raises ValueError for a time beyond the end of a week or a day.
    """
    if system == "R":
        return _glonass_gps_ms(field, near_gps_ms)
    if field >= WEEK_MS:
        msg = f"epoch {field} ms lies beyond the end of the week"
        raise ValueError(msg)
    return nearest(field + (BDT_BEHIND_MS if system == "C" else 0), WEEK_MS, near_gps_ms)


def _glonass_gps_ms(field: int, near_gps_ms: int) -> int:
    weekday, day_ms = field >> _DAY_BITS, field & ((1 << _DAY_BITS) - 1)
    if day_ms >= _LONGEST_DAY_MS:
        msg = f"epoch {day_ms} ms lies beyond the end of the day"
        raise ValueError(msg)
    # UTC counted as if it were GPS time: without leap seconds, from the GPS epoch on.
    near_ms = near_gps_ms - 1000 * _leap_s(near_gps_ms)
    if weekday == _NO_DAY:
        utc_ms = nearest(day_ms - MOSCOW_MS, DAY_MS, near_ms)
    else:
        utc_ms = nearest(weekday * DAY_MS + day_ms - MOSCOW_MS, WEEK_MS, near_ms)
    return _after_leap(utc_ms, near_gps_ms)


def gps_ms_of_utc(utc_ms: int) -> int:
    """GPS time of a UTC time counted without leap seconds from the GPS epoch."""
    return utc_ms + 1000 * leap_seconds(utc_ms / 1000.0 + GPS_EPOCH_UNIX_S)


def _leap_s(gps_ms: int) -> int:
    return leap_seconds(unix_ns_from_gps_ms(gps_ms) / NS)


def _after_leap(utc_ms: int, near_gps_ms: int) -> int:
    """GPS time of a UTC time; of the two readings around a leap second the one nearer to `near_gps_ms`."""
    unix_s = utc_ms / 1000.0 + GPS_EPOCH_UNIX_S
    readings = {utc_ms + 1000 * leap_seconds(unix_s + beside_s) for beside_s in (-1.0, 1.0)}
    return min(sorted(readings), key=lambda gps_ms: abs(gps_ms - near_gps_ms))


def gps_ms_of_day(modified_julian_day: int, second_of_day: int) -> int:
    """GPS time of a UTC day (counted from 1858-11-17) and its second.

    >>> gps_ms_of_day(60083, 23604) // WEEK_MS
    2262
    """
    unix_s = (modified_julian_day - _MJD_OF_UNIX) * 86_400 + second_of_day
    return gps_ms_of_utc(1000 * (unix_s - GPS_EPOCH_UNIX_S))
