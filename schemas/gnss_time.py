"""GPS time against UTC: the one place that knows about leap seconds.

Times on the wire (`t_ns`) are UTC in Unix nanoseconds. Unix time has no leap seconds, so
GPS time minus UTC is a step function of the date; it was 17 s from 2015-07-01 and 18 s
from 2017-01-01 (IERS Bulletin C). No leap second has been announced since; when one is,
it is one more row here. During a leap second itself two GPS instants share a Unix time.
"""

from __future__ import annotations

from typing import Final

import numpy as np

NS: Final = 1_000_000_000
WEEK_S: Final = 604_800
GPS_EPOCH_UNIX_S: Final = 315_964_800
"""1980-01-06T00:00:00Z in Unix seconds (IS-GPS-200, 3.3.4)."""

_LEAPS: Final = (
    # GPS - UTC [s] from this Unix second on (IERS Bulletin C; zero at the GPS epoch).
    (362_793_600, 1),
    (394_329_600, 2),
    (425_865_600, 3),
    (489_024_000, 4),
    (567_993_600, 5),
    (631_152_000, 6),
    (662_688_000, 7),
    (709_948_800, 8),
    (741_484_800, 9),
    (773_020_800, 10),
    (820_454_400, 11),
    (867_715_200, 12),
    (915_148_800, 13),
    (1_136_073_600, 14),
    (1_230_768_000, 15),
    (1_341_100_800, 16),
    (1_435_708_800, 17),
    (1_483_228_800, 18),
)


def leap_seconds(unix_s: float) -> int:
    """GPS time minus UTC in whole seconds at a Unix time.

    >>> leap_seconds(1_465_211_445)
    17
    """
    return max((leap for start, leap in _LEAPS if unix_s >= start), default=0)


def unix_ns_from_gps(week: int, tow_s: float) -> int:
    """UTC in Unix nanoseconds of a GPS week (counted from 1980) and time of week [s].

    >>> unix_ns_from_gps(1900, 126641.7)
    1465211424700000000
    """
    gps_ns = week * WEEK_S * NS + round(tow_s * NS)
    ahead_s = GPS_EPOCH_UNIX_S + gps_ns / NS
    leap = max((leap for start, leap in _LEAPS if ahead_s - leap >= start), default=0)
    return GPS_EPOCH_UNIX_S * NS + gps_ns - leap * NS


def gps_from_unix_ns(t_ns: int) -> tuple[int, float]:
    """GPS week and time of week [s] of a UTC time in Unix nanoseconds.

    >>> gps_from_unix_ns(1465211424700000000)
    (1900, 126641.7)
    """
    gps_ns = t_ns - GPS_EPOCH_UNIX_S * NS + leap_seconds(t_ns / NS) * NS
    week, rest_ns = divmod(gps_ns, WEEK_S * NS)
    return int(week), rest_ns / NS


def gps_from_calendar(year: int, month: int, day: int, hour: int, minute: int, second: float) -> tuple[int, float]:
    """GPS week and time of week [s] of a calendar time on the GPS time scale.

    >>> gps_from_calendar(2016, 6, 6, 11, 10, 41.7)
    (1900, 126641.7)
    """
    days = int(np.datetime64(f"{year:04d}-{month:02d}-{day:02d}", "D").astype(np.int64)) - 3657
    week, weekday = divmod(days, 7)
    return week, weekday * 86_400 + hour * 3_600 + minute * 60 + second
