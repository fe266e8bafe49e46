"""NMEA 0183 logs: a fix from each RMC sentence; a new run after an hour without any."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from pynmeagps import NMEAMessage, NMEAParseError, NMEAReader
from pynmeagps.exceptions import NMEAMessageError, NMEATypeError

from services.run_history.fixes import RunLog, run_log

KNOT_MPS = 1852.0 / 3600.0
APART_S = 3600.0


class NmeaLogError(ValueError):
    """A file without a single usable sentence."""


def read_nmea(path: Path) -> Iterator[RunLog]:
    """Runs of a file; sentences that are damaged are left out. Raises NmeaLogError, OSError."""
    rows: list[tuple[float, float, float, float]] = []
    number = 0
    with path.open("rb") as file:
        for line in file:
            fix = _fix(line)
            if fix is None:
                continue
            if rows and abs(fix[0] - rows[-1][0]) > APART_S:
                number += 1
                yield _run(path, number, rows)
                rows = []
            rows.append(fix)
    if not rows and number == 0:
        msg = f"{path}: no usable RMC sentence in this file"
        raise NmeaLogError(msg)
    yield _run(path, number + 1, rows)


def _run(path: Path, number: int, rows: list[tuple[float, float, float, float]]) -> RunLog:
    return run_log(f"{path.stem}-{number}", *np.array(rows, dtype=np.float64).T)


def _fix(line: bytes) -> tuple[float, float, float, float] | None:
    start = line.find(b"$")
    if start < 0 or line[start + 3 : start + 6] != b"RMC":
        return None
    try:
        message = NMEAReader.parse(line[start:].strip() + b"\r\n")
    except (NMEAParseError, NMEAMessageError, NMEATypeError, ValueError, TypeError, IndexError):
        return None
    if not isinstance(message, NMEAMessage) or getattr(message, "status", "V") != "A":
        return None
    try:
        moment = datetime.combine(message.date, message.time, UTC)
        speed = message.spd
        return (
            moment.timestamp(),
            float(message.lat),
            float(message.lon),
            math.nan if speed in ("", None) else float(speed) * KNOT_MPS,
        )
    except (AttributeError, TypeError, ValueError):
        return None
