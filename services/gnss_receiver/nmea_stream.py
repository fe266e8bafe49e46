"""What a stream of NMEA 0183 sentences says: where the receiver itself believes to be.

Sentences of one instant (GGA, RMC, GST, ZDA) make one message. Source: NMEA 0183, 6.3; parsing by pynmeagps.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from datetime import date, timedelta
from typing import Any, Final

from pynmeagps import VALNONE, NMEAReader
from pynmeagps.exceptions import (
    NMEAMessageError,
    NMEAParseError,
    NMEAStreamError,
    NMEATypeError,
)

from schemas.gnss import FixStatus, OwnMode, OwnPosition
from schemas.gnss_time import NS

_KINDS: Final = frozenset({"GGA", "RMC", "GST", "ZDA"})
_KNOT_MPS: Final = 1852.0 / 3600.0
_DAY_NS: Final = 86_400 * NS
_MODES: Final[tuple[OwnMode, ...]] = (
    "none",
    "autonomous",
    "differential",
    "precise",
    "rtk_fixed",
    "rtk_float",
    "estimated",
    "manual",
    "simulated",
)
"""By the quality of GGA."""
_RMC_MODES: Final[dict[str, OwnMode]] = {
    "A": "autonomous",
    "D": "differential",
    "E": "estimated",
    "F": "rtk_float",
    "M": "manual",
    "N": "none",
    "P": "precise",
    "R": "rtk_fixed",
    "S": "simulated",
}
_NOT_MEASURED: Final = frozenset({"none", "manual", "simulated"})
_ROLLOVER: Final = timedelta(weeks=1024)
_ROLLOVER_SLACK: Final = timedelta(days=2)
_UNIX_DAY: Final = date(1970, 1, 1)
_CLOCK_DIGITS: Final = 6


@dataclass(slots=True)
class _Instant:
    """Sentences of one time of day so far."""

    of_day_ns: int
    sentences: dict[str, Any] = field(default_factory=dict)
    given: bool = False


class NmeaStream:
    """Turns sentences into positions, in their order.

    A position is given as soon as every kind of sentence has come that the instant before had, at
    the latest when the next instant begins.
    """

    def __init__(self, counts: Counter[str], near_ns: int) -> None:
        """Take days from around a time (UTC) until a sentence names them; what is noticed is counted."""
        self._counts = counts
        self._near_ns = near_ns
        self._open: _Instant | None = None
        self._expected: frozenset[str] = frozenset()

    def near(self, t_ns: int) -> None:
        """Take days from around another time (UTC)."""
        self._near_ns = t_ns

    def add(self, content: bytes) -> list[OwnPosition]:
        """Positions that a sentence (without `$` and check) completes. What cannot be read is counted."""
        kind = content.partition(b",")[0][-3:].decode("ascii")
        if kind not in _KINDS or content.startswith(b"P"):
            self._counts[f"not_read_nmea_{kind}"] += 1
            return []
        try:
            of_day_ns, sentence = _read(content)
        except ValueError:
            self._counts[f"bad_nmea_{kind}"] += 1
            return []
        if of_day_ns is None:
            return [] if self._open is None else self._end(self._open)
        positions: list[OwnPosition] = []
        if self._open is None or self._open.of_day_ns != of_day_ns:
            positions = [] if self._open is None else self._end(self._open)
            self._open = _Instant(of_day_ns)
        self._open.sentences[kind] = sentence
        if not self._open.given and self._expected and self._expected <= set(self._open.sentences):
            positions += self._give(self._open)
        return positions

    def cut(self) -> list[OwnPosition]:
        """Position of an instant whose last sentences will not come: the connection ended."""
        return [] if self._open is None else self._end(self._open)

    def _end(self, instant: _Instant) -> list[OwnPosition]:
        self._open = None
        self._expected = frozenset(instant.sentences)
        return [] if instant.given else self._give(instant)

    def _give(self, instant: _Instant) -> list[OwnPosition]:
        instant.given = True
        if not {"GGA", "RMC"} & set(instant.sentences):
            return []
        t_ns = self._day_ns(instant) + instant.of_day_ns
        self._near_ns = t_ns
        return [_position(t_ns, instant.sentences)]

    def _day_ns(self, instant: _Instant) -> int:
        """Start of the day: the one that a sentence names, or the one nearest in time."""
        for kind in ("RMC", "ZDA"):
            named = _date(kind, instant.sentences.get(kind))
            if named is not None:
                return (self._repaired(named) - _UNIX_DAY).days * _DAY_NS
        half_ns = _DAY_NS // 2
        return (self._near_ns - instant.of_day_ns + half_ns) // _DAY_NS * _DAY_NS

    def _repaired(self, named: date) -> date:
        """Date of an old receiver whose week number turned over, which is 1024 weeks behind."""
        near = _UNIX_DAY + timedelta(days=self._near_ns // _DAY_NS)
        if abs(near - named - _ROLLOVER) <= _ROLLOVER_SLACK:
            self._counts["dates_1024_weeks_behind"] += 1
            return named + _ROLLOVER
        return named


def _read(content: bytes) -> tuple[int | None, Any]:
    """Time of day [ns] and the parsed sentence; the time is None where the receiver does not know it.

    Raises ValueError for what cannot be read.
    """
    name, _, rest = content.partition(b",")
    clock, _, fields = rest.partition(b",")
    of_day_ns = _of_day_ns(clock.decode("ascii")) if clock else None
    # The time is read here, because 23:59:60 is no time for the library.
    try:
        return of_day_ns, NMEAReader.parse(b"$" + name + b",000000.00," + fields + b"*00\r\n", validate=VALNONE)
    except (NMEAMessageError, NMEAParseError, NMEAStreamError, NMEATypeError) as error:
        raise ValueError(str(error)) from error


def _of_day_ns(text: str) -> int:
    """Nanoseconds of the day in `hhmmss.ss`; ValueError for what is no time.

    >>> _of_day_ns("235960.25")
    86400250000000
    """
    whole, _, part = text.partition(".")
    if len(whole) != _CLOCK_DIGITS or not (whole + part).isdigit():
        msg = f"{text!r} is no time"
        raise ValueError(msg)
    hour, minute, second = int(whole[:2]), int(whole[2:4]), int(whole[4:])
    if hour > 23 or minute > 59 or second > 60:  # noqa: PLR2004 - a day, with a leap second
        msg = f"{text!r} is no time"
        raise ValueError(msg)
    return (hour * 3600 + minute * 60 + second) * NS + int(f"{part:0<9.9}")


def _date(kind: str, sentence: Any) -> date | None:  # noqa: ANN401 - the library's message
    if kind == "RMC":
        named = getattr(sentence, "date", None)
        return named if isinstance(named, date) else None
    try:
        return date(*(int(getattr(sentence, part)) for part in ("year", "month", "day")))
    except (AttributeError, TypeError, ValueError):
        return None


def _number(sentence: Any, name: str) -> float | None:  # noqa: ANN401 - the library's message
    """Field of a sentence; None for a blank or an impossible one, and where there is no sentence."""
    value = getattr(sentence, name, None)
    number = float(value) if isinstance(value, int | float) else None
    return number if number is not None and math.isfinite(number) else None


def _position(t_ns: int, sentences: dict[str, Any]) -> OwnPosition:
    gga, rmc, gst = (sentences.get(kind) for kind in ("GGA", "RMC", "GST"))
    mode = _mode(gga, rmc)
    source: Any = gga if gga is not None else rmc
    lat_deg, lon_deg = _number(source, "lat"), _number(source, "lon")
    if mode in _NOT_MEASURED or lat_deg is None or lon_deg is None:
        return OwnPosition(t_ns=t_ns, protocol="nmea", status="none", mode=mode if mode in _NOT_MEASURED else "none")
    status: FixStatus = "predicted" if mode == "estimated" else "fix"
    ve_mps, vn_mps = _velocity(rmc)
    height_m, separation_m = _number(gga, "alt"), _number(gga, "sep")
    north_m, east_m, up_m = (_number(gst, name) for name in ("stdLat", "stdLong", "stdAlt"))
    satellites = _number(gga, "numSV")
    return OwnPosition(
        t_ns=t_ns,
        protocol="nmea",
        status=status,
        mode=mode,
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        h_m=None if height_m is None or separation_m is None else round(height_m + separation_m, 4),
        ve_mps=ve_mps,
        vn_mps=vn_mps,
        satellites_used=None if satellites is None else int(satellites),
        hdop=_number(gga, "HDOP"),
        sigma_horizontal_m=None if north_m is None or east_m is None else math.hypot(north_m, east_m),
        sigma_vertical_m=None if up_m is None else abs(up_m),
        correction_age_s=_number(gga, "diffAge"),
    )


def _mode(gga: Any, rmc: Any) -> OwnMode:  # noqa: ANN401 - the library's messages
    """How the position was found; RMC's warning and its mode count where GGA says less."""
    if rmc is not None and getattr(rmc, "status", "V") != "A":
        return "estimated" if getattr(rmc, "posMode", "") == "E" else "none"
    if gga is not None:
        quality = _number(gga, "quality") or 0.0
        return _MODES[int(quality)] if 0 <= quality < len(_MODES) else "none"
    return _RMC_MODES.get(getattr(rmc, "posMode", "A") or "A", "none")


def _velocity(rmc: Any) -> tuple[float | None, float | None]:  # noqa: ANN401 - the library's message
    """East and north [m/s]; a standing receiver may leave the course blank."""
    speed, course = _number(rmc, "spd"), _number(rmc, "cog")
    if speed is None or (course is None and speed > 0.0):
        return None, None
    angle = math.radians(course or 0.0)
    return speed * _KNOT_MPS * math.sin(angle), speed * _KNOT_MPS * math.cos(angle)
