"""passes.csv: rows as readings; what cannot be used is counted and named by file and line."""

from __future__ import annotations

import csv
import gzip
import math
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, TextIO

import msgspec

from services.radio_anomaly.reading import Reading, refusal_of

NEEDED: Final = ("time", "pass_id", "radio", "channel", "power_dbm")
OPTIONAL: Final = (
    "decoded_power_dbm",
    "received_ratio",
    "corrected_bits",
    "frequency_offset_hz",
    "temperature_c",
    "tx_power_dbm",
)
LONGEST_NAME: Final = 64
NAMED: Final = 20
"""Refusals that are named one by one."""
EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


class Rows(msgspec.Struct, kw_only=True):
    """What a file held."""

    readings: list[Reading]
    refused: Counter[str]
    """By reason."""
    named: list[str]
    """The first refusals: file, line, why."""
    rows: int = 0


class _RefusedError(ValueError):
    """A row that cannot be used: reason without figures, and in full."""

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(detail or reason)
        self.reason = reason


def read_passes(path: Path) -> Rows:
    """Every usable row. Raises ValueError for a file without the needed columns or without one usable row; OSError."""
    found = Rows(readings=[], refused=Counter(), named=[])
    with _opened(path) as file:
        try:
            _read(path, csv.DictReader(file), found)
        except (csv.Error, UnicodeDecodeError, EOFError, gzip.BadGzipFile) as error:
            msg = f"{path}: no CSV: {error}"
            raise ValueError(msg) from error
    if not found.readings:
        why = f"; line {found.named[0].rsplit(':', 2)[1]}: {found.named[0].rsplit(': ', 1)[1]}" if found.named else ""
        msg = f"{path}: no usable row of {found.rows}{why}"
        raise ValueError(msg)
    return found


@contextmanager
def _opened(path: Path) -> Iterator[TextIO]:
    if path.suffix == ".gz":
        with gzip.open(path, "rt", encoding="utf-8-sig", newline="") as packed:
            yield packed
    else:
        with path.open(encoding="utf-8-sig", newline="") as plain:
            yield plain


def _read(path: Path, table: csv.DictReader[str], found: Rows) -> None:
    columns = set(table.fieldnames or ())
    missing = [name for name in NEEDED if name not in columns]
    if missing:
        msg = f"{path}:1: no column {', '.join(missing)}; needed are {', '.join(NEEDED)}"
        raise ValueError(msg)
    present = tuple(name for name in OPTIONAL if name in columns)
    for row in table:
        found.rows += 1
        try:
            reading = _reading(row, present)
            reason = refusal_of(reading)
            if reason is not None:
                raise _RefusedError(_general(reason), reason)  # noqa: TRY301 - both kinds of refusal are counted alike
        except _RefusedError as error:
            found.refused[error.reason] += 1
            if len(found.named) < NAMED:
                found.named.append(f"{path}:{table.line_num}: {error}")
        else:
            found.readings.append(reading)


def _general(reason: str) -> str:
    """A reason without its figures, for counting."""
    if reason.startswith("chainage_m"):
        return "chainage off every line"
    name = reason.split(" ", 1)[0]
    return f"{name} out of its range" if name in ("power_dbm", *OPTIONAL) else reason


def _reading(row: dict[str, str], present: tuple[str, ...]) -> Reading:
    if None in row or None in row.values():
        reason = "not as many fields as columns"
        raise _RefusedError(reason)
    direction = row.get("direction", "")
    chainage = row.get("chainage_m", "")
    if direction not in ("up", "down", ""):
        reason = "direction neither up nor down"
        raise _RefusedError(reason, f"{reason}: {direction!r}")
    if not chainage and row.get("side") == "onboard":
        reason = "no place, though measured on board"
        raise _RefusedError(reason)
    if bool(direction) != bool(chainage):
        reason = "one of chainage_m and direction without the other"
        raise _RefusedError(reason)
    for name in ("radio", "channel"):
        if not 1 <= len(row[name]) <= LONGEST_NAME:
            reason = f"{name} empty or too long"
            raise _RefusedError(reason, f"{reason}: {row[name][:70]!r}")
    return Reading(
        t_ns=time_ns(row["time"]),
        pass_id=row["pass_id"],
        radio=row["radio"],
        channel=row["channel"],
        direction=direction or None,  # type: ignore[arg-type]  # checked above
        chainage_m=_number("chainage_m", chainage),
        cell=row.get("cell", "")[:LONGEST_NAME],
        power_dbm=_number("power_dbm", row["power_dbm"]),
        **{name: _number(name, row[name]) for name in present},
    )


def _number(name: str, text: str) -> float | None:
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        reason = f"{name} is no number"
        raise _RefusedError(reason, f"{reason}: {text[:40]!r}") from None
    if not math.isfinite(value):
        reason = f"{name} is no number"
        raise _RefusedError(reason, f"{reason}: {text[:40]!r}")
    return value


def time_ns(text: str) -> int:
    """Unix time of an ISO 8601 time with zone. Raises ValueError."""
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        reason = "time is not ISO 8601"
        raise _RefusedError(reason, f"{reason}: {text[:40]!r}") from None
    if when.tzinfo is None:
        reason = "time without zone"
        raise _RefusedError(reason, f"{reason}: {text[:40]!r}; write 2026-11-22T10:00:00Z")
    gone = when - EPOCH
    return (gone.days * 86_400 + gone.seconds) * 1_000_000_000 + gone.microseconds * 1000
