"""Fields of a report under the names that people give them, as messages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from math import isfinite
from typing import Any, Final, Generic, TypeVar

import msgspec

from schemas.radio import RadioMeasurement, Weather
from services.radio_probe.report_rows import Row

M = TypeVar("M", RadioMeasurement, Weather)
NS: Final = 10**9
TIMES: Final = ("t_ns", "time", "timestamp", "t_s", "t_unix_s")
SAME: Final = {
    "power_dbm": "channel_power_dbm",
    "rssi_dbm": "channel_power_dbm",
    "rsrp_dbm": "decoded_power_dbm",
    "reception": "received_ratio",
    "sinr_db": "snr_db",
    "frequency": "channel",
    "dir": "direction",
}
"""Other names of fields."""
_SECONDS, _MILLISECONDS, _MICROSECONDS = 1e11, 1e14, 1e17
"""Unix times below these are in seconds, milliseconds, microseconds."""
_EARLIEST, _LATEST = -(2**62), 2**62


class NoReportError(ValueError):
    """A row that makes no message; says why."""


@dataclass(slots=True)
class FieldReader(Generic[M]):
    """Makes messages of rows; counts what it does not know."""

    message: type[M]
    usual: Mapping[str, Any]
    """Fields that a row may leave out."""
    unknown: dict[str, int] = field(default_factory=dict)
    """Columns that mean nothing here, by how often they came; the first hundred names."""
    no_zone: int = 0
    """Times without a zone, which may mean anything."""
    no_number: int = 0
    """Cells that hold no finite number where one belongs; they count as not measured."""

    def read(self, row: Row) -> M:
        """The message of a row; its time is 0 when it tells none. Raises NoReportError."""
        fields: dict[str, Any] = dict(self.usual) | {"t_ns": 0}
        texts = {"radio", "channel", "side", "cell", "branch", "direction", "pass_id", "train"}
        for name, value in row.items():
            known = SAME.get(name, name)
            if name in TIMES:
                fields["t_ns"] = self._time_ns(value)
            elif known not in self.message.__struct_fields__:
                if name in self.unknown or len(self.unknown) < 100:  # noqa: PLR2004 - enough to see what is wrong
                    self.unknown[name] = self.unknown.get(name, 0) + 1
            elif known in texts:
                fields[known] = value if isinstance(value, str) else f"{value}"
            elif known == "lightning":
                fields[known] = str(value).lower() in ("1", "true", "yes")
            else:
                fields[known] = self._number(value)
        try:
            return msgspec.convert(fields, self.message)
        except (msgspec.ValidationError, ValueError) as error:
            raise NoReportError(str(error)) from error

    def _number(self, value: object) -> float | None:
        try:
            number = float(value) if isinstance(value, int | float | str) else float("nan")
        except (ValueError, OverflowError):
            number = float("nan")
        if not isfinite(number):
            self.no_number += 1
            return None
        return number

    def _time_ns(self, value: object) -> int:
        """Unix nanoseconds; 0 for a time that says nothing."""
        number = _plain(value)
        if number is not None:
            for limit, unit in ((_SECONDS, NS), (_MILLISECONDS, 10**6), (_MICROSECONDS, 10**3)):
                if abs(number) < limit:
                    return round(number * unit)
            return round(number) if _EARLIEST < number < _LATEST else 0
        try:
            moment = datetime.fromisoformat(str(value))
        except ValueError:
            self.no_zone += 1
            return 0
        if moment.tzinfo is None:
            self.no_zone += 1
            return 0
        try:
            return round(moment.replace(microsecond=0).timestamp()) * NS + moment.microsecond * 1000
        except (ValueError, OverflowError):
            return 0


def _plain(value: object) -> float | None:
    """A number, whether or not it is text; None for what is none. Nanoseconds need all the digits of an integer."""
    try:
        if isinstance(value, int) or (isinstance(value, str) and value.isascii() and value.isdigit()):
            whole = int(value)
            return whole if abs(whole) < _LATEST else None
        number = float(value) if isinstance(value, int | float | str) else float("nan")
    except (ValueError, OverflowError):
        return None
    return number if isfinite(number) else None
