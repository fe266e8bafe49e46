"""The truth beside a motion log, for evaluation alone: truth.parquet|csv, and the wheel's way by the log's pulses."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from services.odometry_fusion.evaluation import MotionTruth, WheelWay
from services.odometry_fusion.motion_log_file import TACHO_COLUMNS, MotionLogError, read_about, read_table

TRUTH_COLUMNS: Final = ("t_s", "distance_m", "speed_mps", "slip")


def read_truth(path: Path) -> MotionTruth:
    """Read and check it. Raises MotionLogError, OSError."""
    if not path.is_file():
        raise MotionLogError(path, "no such file")
    table = read_table(path, TRUTH_COLUMNS)
    table = table[np.isfinite(table).all(axis=1)]
    if len(table) < 2:  # noqa: PLR2004 - a way has two ends
        raise MotionLogError(path, "fewer than two usable rows")
    if (np.diff(table[:, 0]) <= 0.0).any():
        raise MotionLogError(path, "time does not rise", int(np.flatnonzero(np.diff(table[:, 0]) <= 0.0)[0]) + 2)
    return MotionTruth(table[:, 0], table[:, 1], table[:, 2], table[:, 3].astype(np.int64))


def read_wheel_beside(truth: Path) -> WheelWay | None:
    """Way of the wheel by the log in whose folder the truth lies; None where there is none. Raises MotionLogError."""
    folder = truth.parent
    tables = [folder / f"tacho.{ending}" for ending in ("parquet", "csv")]
    present = [path for path in tables if path.is_file()]
    if not present or not (folder / "motion.toml").is_file():
        return None
    about = read_about(folder / "motion.toml")
    table = read_table(present[0], TACHO_COLUMNS)
    table = table[np.isfinite(table).all(axis=1)]
    pulse_m = np.pi * about["wheel_diameter_m"] / about["pulses_per_revolution"]
    return WheelWay(table[:, 0], table[:, 1] * pulse_m)
