"""Logs of runs: tables (CSV, Parquet) with a column of run ids, GPX and NMEA files, and folders of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import duckdb
import numpy as np

from services.run_history.fixes import RunLog, run_log
from services.run_history.gpx_file import read_gpx
from services.run_history.nmea_file import read_nmea

ENDINGS: Final = (".csv", ".parquet", ".gpx", ".nmea", ".txt", ".log")
MEMORY: Final = "512MB"
BATCH_ROWS: Final = 300_000
WANTED: Final = ("t_unix_s", "lat_deg", "lon_deg")
SPEEDS: Final = {
    "speed_kmh": "speed_mps (divide by 3.6)",
    "speed_kph": "speed_mps (divide by 3.6)",
    "speed_knots": "speed_mps (multiply by 0.514444)",
    "speed": "speed_mps (metres per second; its unit is not said)",
    "velocity": "speed_mps (metres per second; its unit is not said)",
}
OTHERS: Final = {
    **SPEEDS,
    "t_ms": "t_unix_s (divide by 1000)",
    "lat": "lat_deg",
    "lon": "lon_deg",
    "latitude": "lat_deg",
    "longitude": "lon_deg",
    "time": "t_unix_s (seconds since 1970)",
}
"""Columns that people have, and what they are to become."""


class RunsLogError(ValueError):
    """A log that cannot be used: path and why."""


def read_runs(path: Path, rejected: list[tuple[Path, str]] | None = None) -> Iterator[RunLog]:
    """Runs of a file or of a folder of files, one after the other. Raises RunsLogError, OSError.

    With a list for them, files of a folder that cannot be read are put there with the reason, and left out.
    """
    if path.is_dir():
        files = sorted(one for one in path.iterdir() if one.suffix.lower() in ENDINGS)
        if not files:
            msg = f"{path}: no file here ends in {', '.join(ENDINGS)}"
            raise RunsLogError(msg)
        for one in files:
            yield from read_runs(one) if rejected is None else _readable(one, rejected)
        return
    try:
        match path.suffix.lower():
            case ".gpx":
                yield from read_gpx(path)
            case ".nmea" | ".txt" | ".log":
                yield from read_nmea(path)
            case ".csv" | ".parquet":
                yield from _read_table(path)
            case other:
                msg = f"{path}: {other or 'no ending'} is none of {', '.join(ENDINGS)}"
                raise RunsLogError(msg)
    except (duckdb.Error, UnicodeDecodeError) as error:
        msg = f"{path}: {str(error).splitlines()[0]}"
        raise RunsLogError(msg) from error


def _readable(path: Path, rejected: list[tuple[Path, str]]) -> Iterator[RunLog]:
    """Runs of a file as far as it can be read; else the reason goes with the rejected ones. Raises OSError."""
    runs = 0
    try:
        for run in read_runs(path):
            runs += 1
            yield run
        if runs == 0:
            rejected.append((path, "no run in it"))
    except ValueError as error:
        rejected.append((path, str(error).removeprefix(str(path)).lstrip(": ")))


def _read_table(path: Path) -> Iterator[RunLog]:
    reader = "read_parquet(?)" if path.suffix.lower() == ".parquet" else "read_csv(?, header=true, sample_size=-1)"
    # Rows go through a table on disk in order of runs: a log of thousands of runs does not fit into memory.
    with TemporaryDirectory(prefix="kirotei-runs-") as folder, duckdb.connect(str(Path(folder, "runs"))) as connection:
        connection.execute("SET threads=1")
        connection.execute(f"SET memory_limit='{MEMORY}'")
        found = connection.execute(f"DESCRIBE SELECT * FROM {reader}", [str(path)]).fetchall()  # noqa: S608 - one of two
        names = {str(row[0]): str(row[1]) for row in found}
        _require(path, names)
        speed = "speed_mps" if "speed_mps" in names else "NULL"
        run = "CAST(run_id AS VARCHAR)" if "run_id" in names else "''"
        columns = [f"TRY_CAST({name} AS DOUBLE) AS {name}" for name in WANTED]
        connection.execute(
            f"CREATE TABLE fixes AS SELECT {run} AS run_id, {', '.join(columns)}, "  # noqa: S608 - names are our own
            f"TRY_CAST({speed} AS DOUBLE) AS speed_mps FROM {reader} ORDER BY run_id",
            [str(path)],
        )
        counts = connection.execute("SELECT run_id, count(*) FROM fixes GROUP BY run_id ORDER BY run_id").fetchall()
        if not counts:
            msg = f"{path}: no rows"
            raise RunsLogError(msg)
        yield from _runs_of(connection, path, counts)


def _runs_of(
    connection: duckdb.DuckDBPyConnection, path: Path, counts: Sequence[tuple[str | None, int]]
) -> Iterator[RunLog]:
    """Runs of the sorted table, some hundred thousand rows at a time."""
    past = 0
    batch: list[tuple[str | None, int]] = []
    for number, one in enumerate(counts):
        batch.append(one)
        size = sum(count for _, count in batch)
        if size < BATCH_ROWS and number < len(counts) - 1:
            continue
        rows = connection.execute(
            "SELECT * FROM fixes WHERE rowid >= ? AND rowid < ? ORDER BY rowid", [past, past + size]
        ).fetchnumpy()
        filled = [_floats(rows[name]) for name in (*WANTED, "speed_mps")]
        start = 0
        for name, count in batch:
            yield run_log(name or path.stem, *(column[start : start + count] for column in filled))
            start += count
        past += size
        batch = []


def _require(path: Path, names: dict[str, str]) -> None:
    missing = [name for name in WANTED if name not in names]
    # A speed in a column of another name would be left out without a word.
    if "speed_mps" not in names and any(name in SPEEDS for name in names):
        missing.append("speed_mps")
    if not missing:
        return
    hints = [f"{name} looks like {OTHERS[name]}" for name in names if name in OTHERS]
    msg = f"{path}: no column {', '.join(missing)}; it has {', '.join(names)}" + (
        f"; {'; '.join(hints)}" if hints else ""
    )
    raise RunsLogError(msg)


def _floats(column: Any) -> np.ndarray[Any, np.dtype[np.float64]]:  # noqa: ANN401 - masked or plain
    return np.asarray(np.ma.filled(np.ma.asarray(column, dtype=np.float64), np.nan), dtype=np.float64)
