"""Reads tables, CSV or Parquet, told apart by their ending, and writes CSV: whole or not at all."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import duckdb

Row = dict[str, str]


class TableError(ValueError):
    """A file that does not hold the table wanted: path, line, what is wrong."""

    def __init__(self, path: Path, line: int, text: str) -> None:
        """Name the file and the line, counted from 1 (0: the file as a whole)."""
        super().__init__(f"{path}:{line}: {text}" if line else f"{path}: {text}")


class Table:
    """Rows of a table, with the line of each."""

    def __init__(self, path: Path, rows: list[tuple[int, Row]]) -> None:
        """Keep the rows as they were read."""
        self.path = path
        self.rows = rows

    def number(self, line: int, row: Row, name: str) -> float:
        """A finite number. Raises TableError naming the line."""
        value = self.number_or_none(line, row, name)
        if value is None:
            raise TableError(self.path, line, f"{name} is blank")
        return value

    def number_or_none(self, line: int, row: Row, name: str) -> float | None:
        """A finite number, or None where the field is blank or not there."""
        text = row.get(name, "").strip()
        if not text:
            return None
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise TableError(self.path, line, f"{name} is {text!r}, which is no number")
        return value


def read_table(path: Path, columns: Sequence[str]) -> Table:
    """Rows of a file that has these columns. Raises TableError, OSError."""
    if path.suffix == ".parquet":
        return _read_parquet(path, columns)
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file, restval="")
            _require(path, reader.fieldnames or (), columns)
            return Table(path, [(reader.line_num, {k: v or "" for k, v in row.items() if k}) for row in reader])
    except (csv.Error, UnicodeDecodeError) as error:
        raise TableError(path, 0, f"not a table: {error}") from error


def _require(path: Path, found: Sequence[str], columns: Sequence[str]) -> None:
    missing = [name for name in columns if name not in found]
    if missing:
        raise TableError(path, 1, f"no column {', '.join(missing)}")


def _read_parquet(path: Path, columns: Sequence[str]) -> Table:
    if not path.exists():
        raise FileNotFoundError(2, "no such file", str(path))
    connection = duckdb.connect()
    try:
        connection.execute("SET threads=1")
        found = connection.execute("select * from read_parquet(?)", [str(path)])
        names = [one[0] for one in found.description or ()]
        _require(path, names, columns)
        rows = found.fetchall()
    except duckdb.Error as error:
        raise TableError(path, 0, f"not a Parquet file: {error}") from error
    finally:
        connection.close()
    return Table(
        path,
        [
            (i + 1, {k: "" if v is None else str(v) for k, v in zip(names, row, strict=True)})
            for i, row in enumerate(rows)
        ],
    )


def write_csv(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table beside its place, then put it there. Raises OSError."""
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(rows)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
