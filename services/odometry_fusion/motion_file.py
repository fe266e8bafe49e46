"""motion.csv: odometry as a table, one row per processing period. Written beside its place, then renamed."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.odometry_fusion.evaluation import MotionTrack
from services.odometry_fusion.motion_log import STATUSES, MotionRows

COLUMNS: Final = ("t_s", "distance_m", "speed_mps", "slip", "bound_m", "status")


class MotionTableError(ValueError):
    """A file that is no motion table: path, line, what is wrong."""

    def __init__(self, path: Path, line: int, text: str) -> None:
        """Name the file and the line, counted from 1 (0: the file as a whole)."""
        super().__init__(f"{path}:{line}: {text}" if line else f"{path}: {text}")


def write_motion(path: Path, rows: MotionRows) -> None:
    """Write the table; `distance_m` counts from the first row. Raises OSError."""
    part = path.with_name(f".{path.name}.part")
    origin_m = rows.distance_m[0] if len(rows) else 0.0
    columns = zip(
        rows.t_s.tolist(),
        (rows.distance_m - origin_m).tolist(),
        rows.speed_mps.tolist(),
        np.abs(rows.slip).tolist(),
        # Rounded up, so that printing never takes anything from a bound.
        (np.ceil(rows.bound_m * 1e4) / 1e4).tolist(),
        rows.status.tolist(),
        strict=True,
    )
    try:
        with part.open("w", encoding="utf-8", newline="") as file:
            file.write(",".join(COLUMNS) + "\n")
            file.writelines(
                f"{t_s:.6f},{distance_m:.4f},{speed_mps:.4f},{slip},{bound_m:.4f},{STATUSES[status]}\n"
                for t_s, distance_m, speed_mps, slip, bound_m, status in columns
            )
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def read_motion(path: Path) -> MotionTrack:
    """Read the table again, a blank bound as NaN. Raises MotionTableError, OSError."""
    numbers: list[list[float]] = []
    words: list[str] = []
    with path.open(encoding="utf-8", newline="") as file:
        table = csv.reader(file)
        header = next(table, [])
        missing = [name for name in COLUMNS if name not in header]
        if missing:
            raise MotionTableError(path, 1, f"no motion table: column {missing[0]!r} is missing")
        places = [header.index(name) for name in COLUMNS]
        for row in table:
            if len(row) != len(header):
                raise MotionTableError(path, table.line_num, f"{len(row)} fields where the header has {len(header)}")
            *cells, status = (row[place] for place in places)
            if status not in STATUSES:
                raise MotionTableError(path, table.line_num, f"status {status!r} is none of {', '.join(STATUSES)}")
            try:
                numbers.append([float(cell) if cell else np.nan for cell in cells])
            except ValueError as error:
                raise MotionTableError(path, table.line_num, str(error)) from error
            words.append(status)
    return _track(path, np.array(numbers), tuple(words))


def _track(path: Path, numbers: NDArray[np.float64], status: tuple[str, ...]) -> MotionTrack:
    if len(numbers) < 2:  # noqa: PLR2004 - a way needs two ends
        raise MotionTableError(path, 0, "fewer than two rows")
    if not np.isfinite(numbers[:, :4]).all():
        line = int(np.flatnonzero(~np.isfinite(numbers[:, :4]).all(axis=1))[0]) + 2
        raise MotionTableError(path, line, "time, distance, speed and slip must be finite numbers")
    if (np.diff(numbers[:, 0]) <= 0.0).any():
        line = int(np.flatnonzero(np.diff(numbers[:, 0]) <= 0.0)[0]) + 3
        raise MotionTableError(path, line, "time does not rise")
    t_s, distance_m, speed_mps, slip, bound_m = numbers.T
    return MotionTrack(path.stem, t_s, distance_m, speed_mps, slip != 0.0, bound_m, status)
