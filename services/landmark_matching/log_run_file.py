"""A motion log from disk as readings for the matching."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from services.landmark_matching.reading import Reading
from services.landmark_matching.run_readings import readings_of
from services.odometry_fusion.methods import run_log
from services.odometry_fusion.motion_log_file import read_motion_log
from services.odometry_fusion.settings import Config


@dataclass(frozen=True, slots=True)
class LogRun:
    """One run."""

    name: str
    readings: list[Reading]
    share: float
    """Error of the distance outside slips."""
    issues: tuple[str, ...]
    """What was left out of the log."""


def read_run(folder: Path, method: Literal["paper", "fused"]) -> LogRun:
    """Read a motion log and run the odometry over it; its truth is never read. Raises MotionLogError, OSError."""
    read = read_motion_log(folder)
    rows = run_log(read.log, Config(method=method))
    return LogRun(folder.resolve().name, readings_of(rows), rows.share_bound, read.issues)
