"""Files of the correction: fixes.csv and verdicts.csv, and the tracks and paths with which they are compared.

Formats as in docs/gnss_correction.md. Files are written beside their place and then renamed, so
that none is ever half there.
"""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final, TextIO

import numpy as np

from schemas.gnss import Fix, Verdicts
from schemas.gnss_time import WEEK_S
from services.gnss_correction.evaluation import FixTrack, Polyline

FIX_COLUMNS: Final = (
    "gps_week",
    "tow_s",
    "status",
    "reason",
    "lat_deg",
    "lon_deg",
    "h_m",
    "ve_mps",
    "vn_mps",
    "vu_mps",
    "satellites_used",
    "satellites_flagged",
    "bound_m",
)
CHAINAGE_COLUMNS: Final = ("chainage_m", "chainage_bound_m")
"""Further columns of fixes on a known line."""
VERDICT_COLUMNS: Final = ("gps_week", "tow_s", "satellite", "multipath_probability", "flagged", "reason")


class TableError(ValueError):
    """A file that is no such table: path, line, what is wrong."""

    def __init__(self, path: Path, line: int, text: str) -> None:
        """Name the file and the line, counted from 1 (0: the file as a whole)."""
        super().__init__(f"{path}:{line}: {text}" if line else f"{path}: {text}")


def _number(value: float | None, decimals: int) -> str:
    return "" if value is None else f"{value:.{decimals}f}"


def _tow(tow_s: float) -> str:
    """Time of week to 0.1 microseconds without trailing zeros."""
    return f"{tow_s:.7f}".rstrip("0").rstrip(".")


class FixesWriter:
    """Writes fixes.csv, and verdicts.csv where wanted, row by row; `close` puts the files into place."""

    def __init__(self, fixes: Path, verdicts: Path | None, *, chainage: bool = False) -> None:
        """Open temporary files beside the wanted ones; fixes with `chainage` where a line is known. Raises OSError."""
        self._chainage = chainage
        self._places = [path for path in (fixes, verdicts) if path is not None]
        self._files: list[TextIO] = []
        try:
            self._files.extend(_part(path).open("w", encoding="utf-8", newline="") for path in self._places)
        except OSError:
            self.discard()
            raise
        self._rows = [csv.writer(file, lineterminator="\n") for file in self._files]
        for rows, columns in zip(
            self._rows, (FIX_COLUMNS + CHAINAGE_COLUMNS * chainage, VERDICT_COLUMNS), strict=False
        ):
            rows.writerow(columns)

    def write_fixes(self, fixes: Iterable[Fix]) -> None:
        """Add one row per epoch."""
        self._rows[0].writerows(
            (
                fix.gps_week,
                _tow(fix.tow_s),
                fix.status,
                fix.reason,
                _number(fix.lat_deg, 9),
                _number(fix.lon_deg, 9),
                _number(fix.h_m, 3),
                _number(fix.ve_mps, 3),
                _number(fix.vn_mps, 3),
                _number(fix.vu_mps, 3),
                fix.satellites_used,
                fix.satellites_flagged,
                _number(fix.bound_m, 2),
                *((_number(fix.chainage_m, 3), _number(fix.chainage_bound_m, 2)) if self._chainage else ()),
            )
            for fix in fixes
        )

    def write_verdicts(self, verdicts: Iterable[Verdicts]) -> None:
        """Add one row per epoch and satellite."""
        self._rows[1].writerows(
            (
                epoch.gps_week,
                _tow(epoch.tow_s),
                one.satellite,
                _number(one.multipath_probability, 4),
                int(one.flagged),
                one.reason,
            )
            for epoch in verdicts
            for one in epoch.satellites
        )

    def close(self) -> None:
        """Put the files into place. Raises OSError."""
        for file in self._files:
            file.flush()
            os.fsync(file.fileno())
            file.close()
        for path in self._places:
            _part(path).replace(path)

    def discard(self) -> None:
        """Leave nothing behind."""
        for file, path in zip(self._files, self._places, strict=False):
            file.close()
            _part(path).unlink(missing_ok=True)


def _part(path: Path) -> Path:
    return path.with_name(f".{path.name}.part")


def _rows(path: Path, wanted: Sequence[str]) -> list[dict[str, str]]:
    """Rows of a CSV file that has the wanted columns, with '' for nothing."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file, restkey="", restval="")
            missing = [name for name in wanted if name not in (reader.fieldnames or ())]
            if missing:
                raise TableError(path, 1, f"no column {', '.join(missing)}")
            rows = list(reader)
    except UnicodeDecodeError as error:
        raise TableError(path, 0, f"not a text file (byte {error.start})") from error
    except csv.Error as error:
        raise TableError(path, 0, f"not a table: {error}") from error
    if not rows:
        raise TableError(path, 0, "holds no row")
    return rows


def _figure(path: Path, line: int, row: dict[str, str], name: str, *, missing: bool = False) -> float:
    """Number in a column; NaN for nothing where that is allowed."""
    text = row[name].strip()
    if missing and text in ("", "None", "nan"):
        return math.nan
    try:
        value = float(text)
    except ValueError:
        raise TableError(path, line, f"{name} is {text!r}, which is no number") from None
    if not math.isfinite(value):
        raise TableError(path, line, f"{name} is {text}")
    return value


def read_fixes(path: Path, name: str) -> FixTrack:
    """Track of a fixes.csv. Raises TableError, OSError."""
    rows = _rows(path, ("gps_week", "tow_s", "status", "lat_deg", "lon_deg", "h_m"))
    figures = np.array(
        [
            (
                _figure(path, line, row, "gps_week") * WEEK_S + _figure(path, line, row, "tow_s"),
                *(_figure(path, line, row, column, missing=True) for column in ("lat_deg", "lon_deg", "h_m")),
            )
            for line, row in enumerate(rows, 2)
        ]
    )
    fixed = np.array([row["status"] == "fix" for row in rows]) & np.isfinite(figures[:, 1:3]).all(axis=1)
    lat_deg, lon_deg, h_m = figures[:, 1:].T
    further = (_optional(path, rows, column) for column in ("bound_m", *CHAINAGE_COLUMNS))
    return FixTrack(name, figures[:, 0], fixed, lat_deg, lon_deg, h_m, *further)


def _optional(path: Path, rows: Sequence[dict[str, str]], name: str) -> np.ndarray | None:
    """A column that a file need not have, NaN for nothing."""
    if name not in rows[0]:
        return None
    return np.array([_figure(path, line, row, name, missing=True) for line, row in enumerate(rows, 2)])


def read_truth(path: Path) -> Polyline:
    """Truth of a run: gps_week, tow_s, lat_deg, lon_deg, h_ell_m, times rising. Raises TableError, OSError."""
    rows = _rows(path, ("gps_week", "tow_s", "lat_deg", "lon_deg", "h_ell_m"))
    t_s = [
        _figure(path, line, row, "gps_week") * WEEK_S + _figure(path, line, row, "tow_s")
        for line, row in enumerate(rows, 2)
    ]
    for line, (before, now) in enumerate(pairwise(t_s), 3):
        if now <= before:
            raise TableError(path, line, "time does not rise")
    return _path(path, rows, t_s)


def _path(path: Path, rows: Sequence[dict[str, str]], at: Sequence[float]) -> Polyline:
    if len(rows) < 2:  # noqa: PLR2004 - a path has two ends
        raise TableError(path, 0, "holds a single point")
    lat_deg, lon_deg, h_m = (
        np.array([_figure(path, line, row, name) for line, row in enumerate(rows, 2)])
        for name in ("lat_deg", "lon_deg", "h_ell_m")
    )
    return Polyline(lat_deg, lon_deg, h_m, np.array(at))


def read_stations(path: Path) -> list[tuple[str, float, float]]:
    """Name, latitude and longitude [deg] of stations: columns name, lat_deg, lon_deg. Raises TableError, OSError."""
    rows = _rows(path, ("name", "lat_deg", "lon_deg"))
    return [
        (row["name"], _figure(path, line, row, "lat_deg"), _figure(path, line, row, "lon_deg"))
        for line, row in enumerate(rows, 2)
    ]
