"""Closed days as Parquet files: `raw/<table>/day=YYYY-MM-DD/NNNNNN.parquet`, in place only when whole."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Final

import duckdb

from services.cloud_analyzer.history import StoreError
from services.cloud_analyzer.tables import Table

DAY_SQL: Final = "strftime(make_timestamp(taken_ns // 1000), '%Y-%m-%d')"


def write_day(connection: duckdb.DuckDBPyConnection, folder: Path, table: Table, day: str) -> Path:
    """One more file of a day: its rows in the table, written beside, synced, renamed. Raises StoreError."""
    place = folder / "raw" / table.name / f"day={day}"
    place.mkdir(parents=True, exist_ok=True)
    number = 1 + max((int(path.stem) for path in place.glob("*.parquet") if path.stem.isdigit()), default=0)
    path, beside = place / f"{number:06d}.parquet", place / f"{number:06d}.new"
    target = str(beside).replace("'", "''")
    sql = (
        f"COPY (SELECT * FROM {table.name} WHERE {DAY_SQL} = $day ORDER BY {', '.join(table.order)}) "  # noqa: S608 - names are our own
        f"TO '{target}' (FORMAT parquet, COMPRESSION zstd)"
    )
    try:
        connection.execute(sql, {"day": day})
        _sync(beside)
        beside.replace(path)
        _sync(place)
    except (duckdb.Error, OSError) as error:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
        msg = f"{path} cannot be written: {str(error).splitlines()[0]}"
        raise StoreError(msg) from error
    return path


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
