"""Rows of answers into CSV or Parquet, written beside and put in place when whole."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Self, TextIO

import duckdb

Row = Sequence[str | float | int | bool | None]


class RowsFile:
    """A file of rows that come page by page; use it in a `with`, which leaves nothing half-written."""

    def __init__(self, path: Path) -> None:
        """Write beside `path`, whose ending tells the form. ValueError for another ending, OSError."""
        if path.suffix not in (".csv", ".parquet"):
            msg = f"{path}: write .csv or .parquet"
            raise ValueError(msg)
        self._path = path
        self._beside = path.with_name(path.name + ".part")
        self._file: TextIO | None = None
        self._columns: tuple[str, ...] | None = None
        self._types: dict[str, set[type]] = {}
        self.rows = 0

    def __enter__(self) -> Self:
        """Open the file beside."""
        self._file = self._beside.open("w", encoding="utf-8", newline="")
        return self

    def write(self, columns: tuple[str, ...], rows: Iterable[Row]) -> None:
        """Append a page. ValueError when its columns are not those of the page before."""
        assert self._file is not None  # noqa: S101 - inside `with`
        writer: Any = csv.writer(self._file)
        if self._columns is None:
            self._columns = columns
            self._types = {name: set() for name in columns}
            writer.writerow(columns)
        elif columns != self._columns:
            msg = f"columns changed from page to page: {self._columns}, {columns}"
            raise ValueError(msg)
        for row in rows:
            writer.writerow(row)
            for name, value in zip(columns, row, strict=True):
                self._types[name].add(type(value))
            self.rows += 1

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Put the file in place, or away after an error."""
        assert self._file is not None  # noqa: S101 - inside `with`
        self._file.close()
        try:
            if kind is None:
                self._put()
        finally:
            self._beside.unlink(missing_ok=True)

    def _put(self) -> None:
        if self._path.suffix == ".csv":
            self._beside.replace(self._path)
            return
        beside = self._beside.with_name(self._beside.name + ".parquet")
        source, target = (str(one).replace("'", "''") for one in (self._beside, beside))
        # Text stays text: a channel '2412' is no number, and a boot id '1e5' neither.
        kinds = {name: _kind(types) for name, types in self._types.items()}
        whole = [name for name, types in self._types.items() if types == {str}]
        options = f"header=true, columns={kinds!r}, force_not_null={whole!r}" if kinds else "header=true"
        with duckdb.connect() as connection:
            connection.execute(
                f"COPY (SELECT * FROM read_csv('{source}', {options})) TO '{target}' (FORMAT parquet)"  # noqa: S608 - paths, quoted, and names of our own
            )
        beside.replace(self._path)


def _kind(types: set[type]) -> str:
    """Column type that takes all of a column's values."""
    known = types - {type(None)}
    if not known or known in ({float}, {int, float}):
        return "DOUBLE"
    return {int: "BIGINT", bool: "BOOLEAN"}.get(next(iter(known)), "VARCHAR") if len(known) == 1 else "VARCHAR"
