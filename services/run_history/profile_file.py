"""A speed profile as CSV, written beside and put in place."""

from __future__ import annotations

import csv
from pathlib import Path

from services.run_history.optimum import Optimum
from services.run_history.optimum_values import CONTROLS


def write_profile(path: Path, profile: Optimum) -> None:
    """Write axis_m, speed_mps, time_s and the control of each step. Raises OSError."""
    beside = path.with_name(path.name + ".part")
    try:
        with beside.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(("axis_m", "speed_mps", "time_s", "control"))
            for axis, speed, time, control in zip(
                profile.axis_m, profile.speed_mps, profile.time_s, profile.control, strict=True
            ):
                writer.writerow((f"{axis:.2f}", f"{speed:.3f}", f"{time:.2f}", CONTROLS[control]))
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
