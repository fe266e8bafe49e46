"""Reads a profile: a CSV of heights, gradients and speed limits along a line."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.line.chainage import LARGEST_CHAINAGE_M

Floats = NDArray[np.float64]

PLACES: Final = ("axis_m", "chainage_m")
HEIGHTS: Final = ("h_m", "height_m", "altitude_m", "h_ell_m")
GRADIENTS: Final = ("gradient_permille", "permille")
LIMITS: Final = {"limit_mps": 1.0, "speed_limit_mps": 1.0, "limit_kmh": 1.0 / 3.6, "speed_limit_kmh": 1.0 / 3.6}
LARGEST_BYTES: Final = 64_000_000
LARGEST_HEIGHT_M: Final = 20_000.0
STEEPEST_PERMILLE: Final = 150.0
SLOWEST_MPS, FASTEST_MPS = 0.1, 140.0
"""A line file takes no more."""


class ProfileFileError(ValueError):
    """A file that holds no profile: path, line, what is wrong."""

    def __init__(self, path: Path, line: int, text: str) -> None:
        """Name the file and the line in it."""
        super().__init__(f"{path}:{line}: {text}" if line else f"{path}: {text}")


@dataclass(frozen=True, slots=True)
class ProfileTable:
    """Rows in rising order of place; columns that the file lacks are None, cells that it lacks NaN."""

    by_chainage: bool
    """Whether places are kilometrage instead of `axis_m`."""
    place_m: Floats
    height_m: Floats | None
    gradient_permille: Floats | None
    """From each row's place on."""
    limit_mps: Floats | None
    """From each row's place on."""


def read_profile(path: Path) -> ProfileTable:
    """Read a profile. Raises ProfileFileError and OSError."""
    if path.stat().st_size > LARGEST_BYTES:
        raise ProfileFileError(path, 0, f"larger than {LARGEST_BYTES // 1_000_000} MB")
    try:
        text = path.read_text("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ProfileFileError(path, 0, f"not a text file (byte {error.start})") from error
    reader = csv.DictReader(io.StringIO(text), restval="")
    names = tuple(reader.fieldnames or ())
    place = next((name for name in PLACES if name in names), None)
    wanted = [name for name in (*HEIGHTS, *GRADIENTS, *LIMITS) if name in names]
    if place is None or not wanted:
        columns = f"{' or '.join(PLACES)}, and any of {', '.join((*HEIGHTS, *GRADIENTS, *LIMITS))}"
        raise ProfileFileError(path, 1, f"columns wanted: {columns}; found: {', '.join(names) or 'none'}")
    try:
        rows = [
            [_number(path, reader.line_num, place, row[place], needed=True)]
            + [_number(path, reader.line_num, name, row[name], needed=False) for name in wanted]
            for row in reader
        ]
    except csv.Error as error:
        raise ProfileFileError(path, 0, f"not a table: {error}") from error
    if not rows:
        raise ProfileFileError(path, 0, "no rows")
    table = np.array(rows)
    table = table[np.argsort(table[:, 0], kind="stable")]

    def column(known: tuple[str, ...]) -> Floats | None:
        found = [name for name in known if name in wanted]
        return table[:, 1 + wanted.index(found[0])] * LIMITS.get(found[0], 1.0) if found else None

    return ProfileTable(place == "chainage_m", table[:, 0], column(HEIGHTS), column(GRADIENTS), column(tuple(LIMITS)))


def _number(path: Path, line: int, name: str, text: str | None, *, needed: bool) -> float:
    """A cell as a number; an empty one that is not needed is NaN."""
    if not needed and not (text or "").strip():
        return math.nan
    try:
        figure = float(text or "")
    except ValueError:
        figure = math.nan
    if not math.isfinite(figure):
        raise ProfileFileError(path, line, f"{name} is {text!r}, which is no number")
    low, high = _range(name)
    if not low <= figure <= high:
        advice = "; leave the cell empty where no limit is stated" if name in LIMITS else ""
        raise ProfileFileError(path, line, f"{name} is {text}: {low:g} to {high:g} is wanted{advice}")
    return figure


def _range(name: str) -> tuple[float, float]:
    """What a column may say; of limits more than nothing."""
    if name in LIMITS:
        return SLOWEST_MPS / LIMITS[name], round(FASTEST_MPS / LIMITS[name], 3)
    largest = {**dict.fromkeys(HEIGHTS, LARGEST_HEIGHT_M - 1.0), **dict.fromkeys(GRADIENTS, STEEPEST_PERMILLE)}
    return -largest.get(name, LARGEST_CHAINAGE_M), largest.get(name, LARGEST_CHAINAGE_M)
