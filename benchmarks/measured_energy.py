"""Computed traction energy against measured battery energy, on drives of an electric car.

    python -m benchmarks.measured_energy drives.parquet [--json]

Speeds (from the wheels, not satellites) go through a moving average of 3 s and the energy model of the trains. One
calibration factor is fitted to every other drive and tried on the rest, both ways round. Measured is what the battery
gave: voltage times current where it discharges. Computed is traction and what was measured of heating and air
conditioning, with an assumed 0.4 kW for the car's electronics. Mass, rolling and air resistance are a BMW i3's with a
driver; the only fitted number is the factor.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import duckdb
import numpy as np
from numpy.typing import NDArray

from services.run_history.track_smoothing import moving_average
from services.run_history.traction_energy import JOULE_PER_KWH, traction_energy
from services.run_history.vehicle import GRAVITY_MPS2, Resistance, Vehicle

Floats = NDArray[np.float64]
CAR = Vehicle(
    name="BMW i3",
    drive="battery",
    mass_t=1.345,
    load_t=0.1,
    load_factor=1.0,
    rotating_mass_share=0.05,
    cars=1,
    resistance=Resistance(a_n=0.010 * 1445.0 * GRAVITY_MPS2, c_n_per_mps2=0.5 * 1.2 * 0.29 * 2.38),
    max_speed_mps=42.0,
)
SLOPE_WINDOW_M = 60.0
"""Elevations are whole metres: slopes are taken over so much way to either side."""
WINDOW_S = 3.0
ELECTRONICS_KW = 0.4
SHORTEST_M = 2000.0


@dataclass(frozen=True, slots=True)
class Drive:
    """Computed and measured energy of a drive [kWh]."""

    name: str
    computed_kwh: float
    measured_kwh: float


def drives(path: Path) -> list[Drive]:
    """All drives of a file that are longer than 2 km. Raises OSError, duckdb.Error."""
    with duckdb.connect() as connection:
        connection.execute("SET threads=1")
        columns = connection.execute(
            "SELECT trip, t, v_kmh, elev, U, I, heat_kW, ac_kW FROM read_parquet(?) ORDER BY trip, t", [str(path)]
        ).fetchnumpy()
    trips = np.asarray(columns["trip"]).astype(str)
    numbers = {
        name: np.ma.filled(np.ma.asarray(columns[name], dtype=np.float64), np.nan) for name in columns if name != "trip"
    }
    found = []
    for trip in np.unique(trips):
        one = drive_of(str(trip), {name: column[trips == trip] for name, column in numbers.items()})
        if one is not None:
            found.append(one)
    return found


def drive_of(name: str, columns: dict[str, Floats]) -> Drive | None:
    """Energy of a drive; None where it is too short or lacks a quantity."""
    t = columns["t"]
    keep = np.concatenate(([True], np.diff(t) > 0.0)) & np.isfinite(columns["U"] * columns["I"] * columns["elev"])
    t, speed, elevation = t[keep], columns["v_kmh"][keep] / 3.6, columns["elev"][keep]
    if len(t) < 2 or np.nansum(speed[1:] * np.diff(t)) < SHORTEST_M:  # noqa: PLR2004 - a step needs two
        return None
    forward = np.maximum(np.nan_to_num(moving_average(t, speed, WINDOW_S)), 0.0)
    way = np.concatenate(([0.0], np.cumsum(0.5 * (forward[1:] + forward[:-1]) * np.diff(t))))
    force = CAR.track_force_n(1000.0 * _slope(way, elevation), np.zeros(len(t)))
    energy = traction_energy(CAR, t, forward, np.gradient(forward, t), np.zeros(len(t)), force)
    aside_w = 1000.0 * (
        np.nan_to_num(columns["heat_kW"][keep]) + np.nan_to_num(columns["ac_kW"][keep]) + ELECTRONICS_KW
    )
    battery_w = np.maximum(-columns["U"][keep] * columns["I"][keep], 0.0)
    return Drive(name, energy.traction_kwh + _integral_kwh(t, aside_w), _integral_kwh(t, battery_w))


def _integral_kwh(t_s: Floats, power_w: Floats) -> float:
    return float(np.sum(0.5 * (power_w[1:] + power_w[:-1]) * np.diff(t_s))) / JOULE_PER_KWH


def _slope(way_m: Floats, elevation_m: Floats) -> Floats:
    grid = np.arange(0.0, way_m[-1] + 1.0, 10.0)
    rising = np.concatenate(([True], np.diff(way_m) > 0.01))  # noqa: PLR2004 - a centimetre: it moves
    height = np.interp(grid, way_m[rising], elevation_m[rising])
    ahead = np.interp(grid + SLOPE_WINDOW_M, grid, height)
    behind = np.interp(grid - SLOPE_WINDOW_M, grid, height)
    span = np.minimum(grid + SLOPE_WINDOW_M, grid[-1]) - np.maximum(grid - SLOPE_WINDOW_M, 0.0)
    return np.asarray(np.interp(way_m, grid, (ahead - behind) / np.maximum(span, 1.0)))


def errors(found: list[Drive], fitted: int) -> tuple[float, Floats]:
    """Factor from the drives of one half (0: even, 1: odd), and relative errors of the other half."""
    computed = np.array([one.computed_kwh for one in found])
    measured = np.array([one.measured_kwh for one in found])
    half = np.arange(len(found)) % 2 == fitted
    factor = float(np.median(measured[half] / computed[half]))
    return factor, np.abs(factor * computed[~half] / measured[~half] - 1.0)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--json", action="store_true")
    told = parser.parse_args()
    found = drives(told.file)
    figures = {}
    for half, name in enumerate(("even", "odd")):
        factor, rest = errors(found, half)
        figures[f"fitted_to_{name}"] = {
            "factor": round(factor, 4),
            "median_percent": round(100.0 * float(np.median(rest)), 2),
            "p95_percent": round(100.0 * float(np.percentile(rest, 95)), 2),
        }
    print(json.dumps({"drives": len(found), **figures}, indent=None if told.json else 1))  # noqa: T201 - a command


if __name__ == "__main__":
    main()
