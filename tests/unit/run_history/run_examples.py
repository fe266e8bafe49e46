"""Rows and traces by hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from services.run_history.run_rows import RunRow
from services.run_history.speed_trace import SpeedTrace

NOON_S = 1_775_012_400.0
"""1 April 2026, 12:00 in Japan."""


def row(number: int, time_s: float, energy_kwh: float, **changes: Any) -> RunRow:  # noqa: ANN401 - any field
    departure = NOON_S + 600.0 * number
    plain: dict[str, Any] = {
        "run_id": f"run{number}",
        "start": "Juso",
        "end": "Toyonaka",
        "departure_s": departure,
        "arrival_s": departure + time_s,
        "running_time_s": time_s,
        "energy_kwh": energy_kwh,
        "energy_sigma_kwh": 1.0,
        "energy_normalised": None,
        "series": "1000",
        "direction": "down",
        "scheduled_s": 420.0,
        "window_s": None,
        "quality": 1.0,
        "excluded_because": "",
    }
    return RunRow(**(plain | changes))


def trace(number: int, way_m: Sequence[float], speed_mps: Sequence[float]) -> SpeedTrace:
    way, speed = np.array(way_m, float), np.array(speed_mps, float)
    return SpeedTrace(
        f"run{number}", NOON_S + 600.0 * number, way, np.linspace(0.0, 10.0 * (len(way) - 1), len(way)), speed
    )
