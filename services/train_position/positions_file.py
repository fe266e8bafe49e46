"""positions.csv: the position, one row per message; and the truth it is held against."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np

from schemas.position import MotionTruth, ReferencePass, TrainPosition
from services.train_position.evaluation import Passes, Positions, Truth
from services.train_position.table_file import TableError, read_table, write_csv

COLUMNS: Final = (
    "t_s",
    "status",
    "axis_m",
    "chainage_m",
    "branch",
    "direction",
    "speed_mps",
    "bound_ahead_m",
    "bound_behind_m",
    "slip",
    "reference",
    "reference_distance_m",
    "reason",
)
PASS_COLUMNS: Final = ("t_s", "reference", "kind", "axis_m", "error_m", "bound_m", "within", "way_m")


def _text(value: float | None) -> str:
    return "" if value is None else f"{value:.4f}"


def write_positions(path: Path, positions: Iterable[TrainPosition]) -> None:
    """Write the table. Bounds are rounded up, so that printing takes nothing from them. Raises OSError."""
    write_csv(
        path,
        COLUMNS,
        (
            (
                f"{one.t_ns / 1e9:.6f}",
                one.status,
                _text(one.axis_m),
                _text(one.chainage_m),
                one.branch if one.branch is not None else "?",
                one.direction or "",
                _text(one.speed_mps),
                "" if one.bound_ahead_m is None else _text(one.bound_ahead_m + 1e-4),
                "" if one.bound_behind_m is None else _text(one.bound_behind_m + 1e-4),
                int(one.slip != 0),
                one.reference,
                _text(one.reference_distance_m),
                one.reason,
            )
            for one in positions
        ),
    )


def write_passes(path: Path, passes: Iterable[ReferencePass]) -> None:
    """Write error against bound at every balise and landmark. Raises OSError."""
    write_csv(
        path,
        PASS_COLUMNS,
        (
            (
                f"{one.t_ns / 1e9:.6f}",
                one.reference,
                one.kind,
                f"{one.axis_m:.3f}",
                f"{one.error_m:.3f}",
                f"{one.bound_m:.3f}",
                int(one.within),
                f"{one.way_m:.1f}",
            )
            for one in passes
        ),
    )


def read_positions(path: Path) -> Positions:
    """Read a positions.csv. Raises TableError, OSError."""
    table = read_table(path, COLUMNS[:9])
    rows: list[tuple[float, ...]] = []
    for line, row in table.rows:
        figures = [table.number(line, row, "t_s")]
        for name in ("axis_m", "bound_ahead_m", "bound_behind_m"):
            figure = table.number_or_none(line, row, name)
            figures.append(np.nan if figure is None else figure)
        figures += [-1.0 if row["direction"] == "down" else 1.0, table.number_or_none(line, row, "slip") or 0.0]
        rows.append(tuple(figures))
    if not rows:
        raise TableError(path, 0, "no rows")
    t_s, axis_m, ahead_m, behind_m, sign, slip = np.array(rows, float).T
    status = tuple(row["status"] for _, row in table.rows)
    return Positions(path.stem, t_s, axis_m, ahead_m, behind_m, sign, slip != 0.0, status)


def positions_of(name: str, messages: list[TrainPosition]) -> Positions:
    """The same from messages."""

    def column(values: Iterable[float | None]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.array([np.nan if one is None else one for one in values], float)

    return Positions(
        name,
        column(one.t_ns / 1e9 for one in messages),
        column(one.axis_m for one in messages),
        column(one.bound_ahead_m for one in messages),
        column(one.bound_behind_m for one in messages),
        column(-1.0 if one.direction == "down" else 1.0 for one in messages),
        np.array([one.slip != 0 for one in messages], bool),
        tuple(one.status for one in messages),
    )


def truth_of(messages: list[MotionTruth]) -> Truth:
    """Truth from messages."""
    return Truth(np.array([one.t_ns / 1e9 for one in messages]), np.array([one.axis_m for one in messages]))


def read_truth(path: Path) -> Truth:
    """Read t_s and axis_m of the front end (place.parquet, or CSV). Raises TableError, OSError."""
    table = read_table(path, ("t_s", "axis_m"))
    rows = [(table.number(line, row, "t_s"), table.number(line, row, "axis_m")) for line, row in table.rows]
    if len(rows) < 2:  # noqa: PLR2004 - between two rows the truth is interpolated
        raise TableError(path, 0, "a truth needs two rows")
    t_s, axis_m = np.array(rows, float).T
    if np.any(np.diff(t_s) < 0.0):
        raise TableError(path, int(np.flatnonzero(np.diff(t_s) < 0.0)[0]) + 2, "t_s falls")
    return Truth(t_s, axis_m)


def read_passes(path: Path) -> Passes:
    """Read a passes table of `write_passes`. Raises TableError, OSError."""
    table = read_table(path, PASS_COLUMNS)
    return Passes(
        np.array([table.number(line, row, "t_s") for line, row in table.rows]),
        tuple(row["reference"] for _, row in table.rows),
        tuple(row["kind"] for _, row in table.rows),
    )
