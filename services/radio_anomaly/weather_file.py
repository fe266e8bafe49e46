"""weather.csv: weather by place and time, beside passes.csv."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Final

import msgspec

from schemas.radio import Weather
from services.radio_anomaly.passes_file import time_ns

VALUES: Final = ("temperature_c", "rain_mm_per_h", "snow_mm_per_h", "snow_depth_cm")


def read_weather(path: Path) -> list[Weather]:
    """Every row, in order of time. Raises ValueError naming file and line, OSError."""
    found = []
    with path.open(encoding="utf-8-sig", newline="") as file:
        table = csv.DictReader(file)
        missing = [name for name in ("time", "axis_m") if name not in (table.fieldnames or ())]
        if missing:
            msg = f"{path}:1: no column {', '.join(missing)}"
            raise ValueError(msg)
        for row in table:
            try:
                values = {name: float(row[name]) for name in (*VALUES, "axis_m", "reach_m") if row.get(name)}
                if not all(math.isfinite(value) for value in values.values()):
                    msg = "a value is no number"
                    raise ValueError(msg)  # noqa: TRY301 - told with file and line like every other
                # msgspec checks limits when it converts.
                found.append(msgspec.convert({"t_ns": time_ns(row["time"]), **values}, Weather))
            except (ValueError, TypeError) as error:
                msg = f"{path}:{table.line_num}: {error}"
                raise ValueError(msg) from error
    return sorted(found, key=lambda word: (word.t_ns, word.axis_m))
