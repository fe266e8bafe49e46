"""Logs of runs: tables (CSV, Parquet) with a column of run ids, GPX and NMEA files, and folders of them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import duckdb
import numpy as np

from services.run_history.fixes import RunLog, run_log
from services.run_history.gpx_file import read_gpx
from services.run_history.nmea_file import read_nmea

ENDINGS: Final = (".csv", ".parquet", ".gpx", ".nmea", ".txt", ".log")
WANTED: Final = ("t_unix_s", "lat_deg", "lon_deg")
OTHERS: Final = {
    "speed_kmh": "speed_mps (divide by 3.6)",
    "speed_knots": "speed_mps (multiply by 0.514444)",
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


def read_runs(path: Path) -> Iterator[RunLog]:
    """Runs of a file or of a folder of files, one after the other. Raises RunsLogError, OSError."""
    if path.is_dir():
        files = sorted(one for one in path.iterdir() if one.suffix.lower() in ENDINGS)
        if not files:
            msg = f"{path}: no file here ends in {', '.join(ENDINGS)}"
            raise RunsLogError(msg)
        for one in files:
            yield from read_runs(one)
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


def _read_table(path: Path) -> Iterator[RunLog]:
    reader = "read_parquet(?)" if path.suffix.lower() == ".parquet" else "read_csv(?, header=true, sample_size=-1)"
    with duckdb.connect() as connection:
        connection.execute("SET threads=1")
        found = connection.execute(f"DESCRIBE SELECT * FROM {reader}", [str(path)]).fetchall()  # noqa: S608 - one of two
        names = {str(row[0]): str(row[1]) for row in found}
        _require(path, names)
        speed = "speed_mps" if "speed_mps" in names else "NULL"
        run = "CAST(run_id AS VARCHAR)" if "run_id" in names else "''"
        columns = [f"TRY_CAST({name} AS DOUBLE) AS {name}" for name in WANTED]
        rows = connection.execute(
            f"SELECT {run} AS run_id, {', '.join(columns)}, TRY_CAST({speed} AS DOUBLE) AS speed_mps "  # noqa: S608 - names are our own
            f"FROM {reader} ORDER BY run_id",
            [str(path)],
        ).fetchnumpy()
    ids = np.asarray(rows["run_id"], dtype=object)
    if len(ids) == 0:
        msg = f"{path}: no rows"
        raise RunsLogError(msg)
    first = np.flatnonzero(np.concatenate(([True], ids[1:] != ids[:-1])))
    filled = [_floats(rows[name]) for name in (*WANTED, "speed_mps")]
    for start, past in zip(first, [*first[1:], len(ids)], strict=True):
        yield run_log(str(ids[start]) or path.stem, *(one[start:past] for one in filled))


def _require(path: Path, names: dict[str, str]) -> None:
    missing = [name for name in WANTED if name not in names]
    if not missing:
        return
    hints = [f"{name} looks like {OTHERS[name]}" for name in names if name in OTHERS]
    msg = f"{path}: no column {', '.join(missing)}; it has {', '.join(names)}" + (
        f"; {'; '.join(hints)}" if hints else ""
    )
    raise RunsLogError(msg)


def _floats(column: Any) -> np.ndarray[Any, np.dtype[np.float64]]:  # noqa: ANN401 - masked or plain
    return np.asarray(np.ma.filled(np.ma.asarray(column, dtype=np.float64), np.nan), dtype=np.float64)
