"""Reading runs.csv back: rows as they were written, with clear words for what is wrong in them."""

from __future__ import annotations

import csv
import math
from datetime import datetime
from pathlib import Path
from typing import Literal

from services.run_history.run_rows import RunRow
from services.run_history.runs_file import ALWAYS, APART, RunsFileError


def read_rows(path: Path) -> list[RunRow]:
    """Rows of a runs.csv. Raises RunsFileError naming file, line and column, and OSError."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            missing = [name for name in ALWAYS if name not in (reader.fieldnames or ())]
            if missing:
                msg = f"{path}:1: no runs.csv: without the columns {', '.join(missing)}"
                raise RunsFileError(msg)
            return [_row(row, f"{path}:{reader.line_num}") for row in reader]
    except (UnicodeDecodeError, csv.Error) as error:
        msg = f"{path}: {error}"
        raise RunsFileError(msg) from error


def _row(row: dict[str, str | None], where: str) -> RunRow:
    return RunRow(
        row["run_id"] or "",
        row["from"] or "",
        row["to"] or "",
        _instant(row, "departure", where),
        _instant(row, "arrival", where),
        _figure(row, "running_time_s", where),
        _figure(row, "energy_kwh", where),
        _figure(row, "energy_uncertainty", where),
        _maybe(row, "energy_normalised", where),
        row["series"] or "",
        _direction(row, where),
        _maybe(row, "scheduled_s", where),
        _maybe(row, "window_s", where),
        _figure(row, "quality", where),
        row["excluded_because"] or "",
        *(_maybe(row, name, where) for name in APART),
    )


def _direction(row: dict[str, str | None], where: str) -> Literal["up", "down"]:
    match row["direction"]:
        case "up":
            return "up"
        case "down":
            return "down"
        case other:
            msg = f"{where}: direction is {other!r}, wanted is up or down"
            raise RunsFileError(msg)


def _instant(row: dict[str, str | None], name: str, where: str) -> float:
    try:
        at = datetime.fromisoformat(row[name] or "")
    except ValueError as error:
        msg = f"{where}: {name} is {row[name]!r}, wanted is a time as 2026-01-31T10:15:00Z"
        raise RunsFileError(msg) from error
    if at.tzinfo is None:
        msg = f"{where}: {name} is {row[name]!r}, without its time zone"
        raise RunsFileError(msg)
    return at.timestamp()


def _maybe(row: dict[str, str | None], name: str, where: str) -> float | None:
    return _figure(row, name, where) if row.get(name) else None


def _figure(row: dict[str, str | None], name: str, where: str) -> float:
    try:
        value = float(row[name] or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        msg = f"{where}: {name} is {row[name]!r}, wanted is a number"
        raise RunsFileError(msg)
    return value
