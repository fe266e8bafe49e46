"""Writing a runs log: t_unix_s, lat_deg, lon_deg, speed_mps, run_id as CSV."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from pathlib import Path

from services.run_history.fixes import RunLog

HEADS = ("t_unix_s", "lat_deg", "lon_deg", "speed_mps", "run_id")


def write_runs_log(path: Path, runs: Iterable[RunLog]) -> None:
    """Write runs one after the other, beside and then in place. Raises OSError."""
    beside = path.with_name(path.name + ".part")
    try:
        with beside.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(HEADS)
            for run in runs:
                columns = (run.t_unix_s, run.lat_deg, run.lon_deg, run.speed_mps)
                for t, lat, lon, speed in zip(*(one.tolist() for one in columns), strict=True):
                    said = "" if math.isnan(speed) else f"{speed:.2f}"
                    writer.writerow((f"{t:.3f}", f"{lat:.7f}", f"{lon:.7f}", said, run.run_id))
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
