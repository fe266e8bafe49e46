"""Reads lines: the JSON line file (schemas/line.py), or a CSV polyline (chainage_m, lat_deg, lon_deg, h_ell_m).

In a CSV polyline two rows at one place are a broken chain: the chainage jumps there.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from schemas.line import Line
from services.line.axis import Axis, AxisError, axis_of
from services.line.chainage import Chainage, ChainageError, chainage_of

COLUMNS: Final = ("chainage_m", "lat_deg", "lon_deg", "h_ell_m")
LARGEST_BYTES: Final = 256_000_000
"""A vertex per metre of a long line has some 50 MB."""


class LineFileError(ValueError):
    """A file that holds no line: path, line or field, what is wrong."""

    def __init__(self, path: Path, where: str, text: str) -> None:
        """Name the file and the spot in it."""
        super().__init__(f"{path}:{where}: {text}" if where else f"{path}: {text}")


@dataclass(frozen=True, slots=True)
class LineGeometry:
    """A line as the mathematics wants it."""

    id: str
    name: str
    axis: Axis
    chainage: Chainage


def read_line(path: Path) -> LineGeometry:
    """Read a line file or a CSV polyline, told apart by their first character. Raises LineFileError, OSError."""
    if path.stat().st_size > LARGEST_BYTES:
        raise LineFileError(path, "", f"larger than {LARGEST_BYTES // 1_000_000} MB")
    try:
        text = path.read_text("utf-8-sig")
    except UnicodeDecodeError as error:
        raise LineFileError(path, "", f"not a text file (byte {error.start})") from error
    return _from_json(path, text) if text.lstrip()[:1] in ("{", "[") else _from_csv(path, text)


def _from_json(path: Path, text: str) -> LineGeometry:
    try:
        line = msgspec.json.decode(text, type=Line)
    except msgspec.DecodeError as error:
        raise LineFileError(path, "", str(error)) from error
    try:
        axis = axis_of(
            [vertex[1] for vertex in line.axis],
            [vertex[0] for vertex in line.axis],
            [vertex[2] for vertex in line.axis],
        )
    except AxisError as error:
        raise LineFileError(path, f"$.axis[{error.vertex}]", error.text) from error
    if not line.chainage:
        ends = np.array([0.0, axis.length_m])
        return LineGeometry(line.id, line.name, axis, Chainage(ends, ends))
    try:
        chainage = chainage_of([one.axis_m for one in line.chainage], [one.chainage_m for one in line.chainage])
    except ChainageError as error:
        raise LineFileError(path, f"$.chainage[{error.place}]", error.text) from error
    return LineGeometry(line.id, line.name, axis, chainage)


def _from_csv(path: Path, text: str) -> LineGeometry:
    rows = _figures(path, text)
    chainage, lat, lon, height = np.array(rows).T
    try:
        axis = axis_of(lat, lon, height)
        given = _chainage_along(axis, chainage)
    except AxisError as error:
        raise LineFileError(path, str(error.vertex + 2), error.text) from error
    except ChainageError as error:
        raise LineFileError(path, "", f"chainage, {error}") from error
    return LineGeometry(path.stem, path.stem, axis, given)


def _figures(path: Path, text: str) -> list[tuple[float, ...]]:
    """The wanted columns as numbers."""
    try:
        reader = csv.DictReader(io.StringIO(text), restval="")
        missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
        if missing:
            raise LineFileError(path, "1", f"no column {', '.join(missing)}, and no JSON line file")
        rows = []
        for row in reader:
            figures = []
            for name in COLUMNS:
                try:
                    figures.append(float(row[name]))
                except ValueError:
                    figures.append(math.nan)
                if not math.isfinite(figures[-1]):
                    raise LineFileError(path, str(reader.line_num), f"{name} is {row[name]!r}, which is no number")
            rows.append(tuple(figures))
    except csv.Error as error:
        raise LineFileError(path, "", f"not a table: {error}") from error
    if len(rows) < 2:  # noqa: PLR2004 - a polyline has two ends
        raise LineFileError(path, "", "a polyline needs two points")
    return rows


def _chainage_along(axis: Axis, chainage_m: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Chainage:
    """Kilometrage of the rows; a row that repeats its place adds the chainage after a break."""
    places: list[float] = []
    given: list[float] = []
    for k, first in enumerate(axis.vertex.tolist()):
        last = int(axis.vertex[k + 1]) if k + 1 < len(axis.vertex) else len(chainage_m)
        at_place = chainage_m[first:last]
        ends = [float(at_place[0])]
        if at_place[-1] != at_place[0] and 0 < k < len(axis.vertex) - 1:
            ends.append(float(at_place[-1]))
        for one in ends:
            places.append(float(axis.axis_m[k]))
            given.append(one)
    return chainage_of(places, given)
