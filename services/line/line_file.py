"""Reads lines: the JSON line file (schemas/line.py), a CSV polyline (chainage_m, lat_deg, lon_deg, h_ell_m), or a name.

In a CSV polyline two rows at one place are a broken chain: the chainage jumps there. `demo` is the line that comes
with Kirotei, whatever lies in the current folder; a file of that name is meant by a path with a folder in it.
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

from schemas.line import Branch, ChainagePoint, Line
from services.line.axis import Axis, AxisError, axis_of
from services.line.built_in_file import built_in_line, built_in_names
from services.line.chainage import Chainage, ChainageError, chainage_of
from services.line.geometry_check import SMALLEST_RADIUS_M
from services.line.route import (
    BACKWARDS_RAD,
    axis_through,
    branch_axis,
    branch_chainage,
    junction_fault,
    main_chainage,
    turn_at_junction_rad,
)

COLUMNS: Final = ("chainage_m", "lat_deg", "lon_deg", "h_ell_m")
LONGEST_ID: Final = 64
LARGEST_BYTES: Final = 256_000_000
"""A vertex per metre of a long line has some 50 MB."""
VERTEX_ADVICE: Final = "; a vertex is [longitude, latitude, height]: degrees (WGS 84) and metres"
BACKWARDS: Final = (
    "the branch leaves towards falling axis_m, and routes rise: turn the line round, or describe the branch as a line"
)


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


@dataclass(frozen=True, slots=True)
class LoadedLine:
    """A line with the geometry of its main line."""

    line: Line
    geometry: LineGeometry


def read_line(path: Path) -> LineGeometry:
    """Geometry of the main line; for the rest see `load_line`."""
    return load_line(path).geometry


def load_line(path: Path) -> LoadedLine:
    """Read a line file or a CSV polyline, told apart by their first character, or a line that comes with Kirotei.

    Of a CSV polyline the line has axis and kilometrage alone. Raises LineFileError, OSError.
    """
    text = _text(path)
    if text is not None and text.lstrip()[:1] not in ("{", "["):
        return _from_csv(path, text)
    return _checked(path, _decoded(path, text))


def decode_line(path: Path) -> Line:
    """The line of a file without a look at its geometry, so that every problem of it can be listed.

    Raises LineFileError and OSError.
    """
    text = _text(path)
    if text is not None and text.lstrip()[:1] not in ("{", "["):
        return _from_csv(path, text).line
    return _decoded(path, text)


def _text(path: Path) -> str | None:
    """What stands in a file; None for the name of a line that comes with Kirotei."""
    if str(path) in built_in_names():
        return None
    if path.is_dir():
        raise LineFileError(path, "", "a folder, not a line file")
    if path.stat().st_size > LARGEST_BYTES:
        raise LineFileError(path, "", f"larger than {LARGEST_BYTES // 1_000_000} MB")
    try:
        return path.read_text("utf-8-sig")
    except UnicodeDecodeError as error:
        raise LineFileError(path, "", f"not a text file (byte {error.start})") from error


def _decoded(path: Path, text: str | None) -> Line:
    """The line of a JSON text, or the built-in one."""
    if text is None:
        return built_in_line(str(path))
    try:
        return msgspec.json.decode(text, type=Line)
    except msgspec.DecodeError as error:
        advice = VERTEX_ADVICE if "axis[" in str(error) else ""
        raise LineFileError(path, "", f"{error}{advice}") from error
    except RecursionError as error:
        raise LineFileError(path, "", "lists and objects are nested too deeply for a line file") from error


def _checked(path: Path, line: Line) -> LoadedLine:
    """With its geometry; refused where axis, kilometrage or a curve is none, on the main line or on a branch."""
    _require_curves(path, line)
    try:
        axis = axis_through(line.axis)
        chainage = main_chainage(line, axis)
    except AxisError as error:
        raise LineFileError(path, f"$.axis[{error.vertex}]", error.text) from error
    except ChainageError as error:
        raise LineFileError(path, f"$.chainage[{error.place}]", error.text) from error
    for number, branch in enumerate(line.branches):
        if fault := junction_fault(axis, branch):
            raise LineFileError(path, f"$.branches[{number}].leaves_axis_m", fault)
        try:
            branch_axis(axis, branch)
            branch_chainage(line, axis, branch)
            if turn_at_junction_rad(axis, branch) > BACKWARDS_RAD:
                raise LineFileError(path, f"$.branches[{number}].axis", BACKWARDS)
        except AxisError as error:
            raise LineFileError(path, f"$.branches[{number}].axis[{error.vertex}]", error.text) from error
        except ChainageError as error:
            raise LineFileError(path, f"$.branches[{number}].chainage", error.text) from error
    return LoadedLine(line, LineGeometry(line.id, line.name, axis, chainage))


def _require_curves(path: Path, line: Line) -> None:
    """Refuse curves without a radius or a length, on the main line and on branches."""
    sources: list[tuple[str, Line | Branch]] = [
        ("$", line),
        *((f"$.branches[{k}]", branch) for k, branch in enumerate(line.branches)),
    ]
    for where, source in sources:
        for number, curve in enumerate(source.curves):
            if abs(curve.radius_m) < SMALLEST_RADIUS_M or not curve.start_axis_m < curve.end_axis_m:
                spot = f"{where}.curves[{number}]"
                raise LineFileError(
                    path, spot, "no curve: a radius of metres, not 0, and an end beyond its start are wanted"
                )


def _from_csv(path: Path, text: str) -> LoadedLine:
    rows = _figures(path, text)
    chainage, lat, lon, height = np.array(rows).T
    try:
        axis = axis_of(lat, lon, height)
        given = _chainage_along(axis, chainage)
    except AxisError as error:
        raise LineFileError(path, str(error.vertex + 2), error.text) from error
    except ChainageError as error:
        raise LineFileError(path, "", f"chainage, {error}") from error
    line = Line(
        id=path.stem[:LONGEST_ID] or "line",
        name=path.stem,
        axis=tuple((float(lon[k]), float(lat[k]), float(height[k])) for k in axis.vertex),
        chainage=tuple(
            ChainagePoint(axis_m=float(place), chainage_m=float(one))
            for place, one in zip(given.axis_m, given.chainage_m, strict=True)
        ),
    )
    return LoadedLine(line, LineGeometry(path.stem, path.stem, axis, given))


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
