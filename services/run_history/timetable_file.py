"""Scheduled running times: CSV with from, to, running_time_s."""

from __future__ import annotations

import csv
import math
from pathlib import Path


class TimetableError(ValueError):
    """A timetable that cannot be used: path, line, why."""


def read_timetable(path: Path) -> dict[tuple[str, str], float]:
    """Running time [s] by the two stations' names. Raises TimetableError, OSError."""
    found: dict[tuple[str, str], float] = {}
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            if not {"from", "to", "running_time_s"} <= set(reader.fieldnames or ()):
                msg = f"{path}:1: wanted are the columns from, to, running_time_s"
                raise TimetableError(msg)
            for row in reader:
                found[row["from"], row["to"]] = _seconds(path, reader.line_num, row["running_time_s"])
    except (UnicodeDecodeError, csv.Error) as error:
        msg = f"{path}: {error}"
        raise TimetableError(msg) from error
    return found


def _seconds(path: Path, line: int, text: str | None) -> float:
    try:
        seconds = float(text or "")
    except ValueError:
        seconds = math.nan
    if not 0.0 < seconds < 86_400.0:  # noqa: PLR2004 - a day
        msg = f"{path}:{line}: running_time_s is {text!r}, wanted are seconds"
        raise TimetableError(msg)
    return seconds
