"""runs.csv: a row for each leg, written beside and put in place."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from services.run_history.run_rows import RunRow

ALWAYS: Final = (
    "run_id",
    "from",
    "to",
    "departure",
    "arrival",
    "running_time_s",
    "energy_kwh",
    "energy_uncertainty",
    "energy_normalised",
    "series",
    "direction",
    "scheduled_s",
    "window_s",
    "quality",
    "excluded_because",
)
APART: Final = (
    "energy_noise_kwh",
    "energy_noise_uncertainty",
    "regenerated_kwh",
    "regenerated_uncertainty",
    "auxiliaries_kwh",
    "auxiliaries_uncertainty",
)
"""Blank or missing where a table does not tell."""
COLUMNS: Final = ALWAYS + APART


class RunsFileError(ValueError):
    """A file that is no runs.csv: path, line, why."""


def write_runs(path: Path, rows: Iterable[RunRow]) -> None:
    """Write rows. Raises OSError."""
    beside = path.with_name(path.name + ".part")
    try:
        with beside.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            writer.writerows(_fields(row) for row in rows)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def _fields(row: RunRow) -> Sequence[str]:
    return (
        row.run_id,
        row.start,
        row.end,
        _iso(row.departure_s),
        _iso(row.arrival_s),
        f"{row.running_time_s:.1f}",
        f"{row.energy_kwh:.3f}",
        f"{row.energy_sigma_kwh:.3f}",
        "" if row.energy_normalised is None else f"{row.energy_normalised:.4f}",
        row.series,
        row.direction,
        "" if row.scheduled_s is None else f"{row.scheduled_s:g}",
        "" if row.window_s is None else f"{row.window_s:g}",
        f"{row.quality:.2f}",
        row.excluded_because,
        *(
            "" if value is None else f"{value:.3f}"
            for value in (
                row.energy_noise_kwh,
                row.energy_noise_sigma_kwh,
                row.regenerated_kwh,
                row.regenerated_sigma_kwh,
                row.auxiliaries_kwh,
                row.auxiliaries_sigma_kwh,
            )
        ),
    )


def _iso(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
