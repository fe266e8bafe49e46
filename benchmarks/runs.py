"""Runs from logs: projecting a million fixes, and analysing ten thousand runs from one table on two cores.

Lines and runs are made here: a winding line of 25 km with a vertex every 5 m, runs of 20 km with nine stops at 1 Hz,
noise of 5 m and 0.15 m/s. Ten thousand runs are RUNS × rounds of them in one Parquet file, read and analysed as
`kirotei runs analyse` does, by one process for each of two cores; the time is scaled to ten thousand.
"""

from __future__ import annotations

import json as json_text
import resource
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import duckdb
import numpy as np
from numpy.typing import NDArray

from schemas.line import Line, Station
from services.line.alignment import Alignment, alignment_of
from services.line.route_projection import project_run
from services.run_history.log_analysis import Job, analysed_runs
from services.run_history.runs_log_file import read_runs
from services.run_history.vehicle import Vehicle

Floats = NDArray[np.float64]
LENGTH_M = 25_000.0
FIXES = 1_000_000
RUNS = 200
TEN_THOUSAND = 10_000
CORES = 2
STATION_M = 2000.0
METRES_PER_LAT = 110_940.0
METRES_PER_LON = 111_320.0 * float(np.cos(np.radians(35.0)))
TRAIN = Vehicle(name="bench", mass_t=120.0)


@dataclass(frozen=True, slots=True)
class Row:
    """One figure beside what is wanted of it."""

    figure: str
    value: float
    wanted: float

    @property
    def reached(self) -> bool:
        """Whether it is as small as wanted."""
        return self.value <= self.wanted


def line_of() -> Line:
    """A winding line of 25 km, a vertex every 5 m, a station every 2 km."""
    axis_m = np.arange(0.0, LENGTH_M + 1.0, 5.0)
    heading = 0.6 * np.sin(axis_m / 900.0)
    east = np.concatenate(([0.0], np.cumsum(np.diff(axis_m) * np.cos(heading[1:]))))
    north = np.concatenate(([0.0], np.cumsum(np.diff(axis_m) * np.sin(heading[1:]))))
    lat, lon = 35.0 + north / METRES_PER_LAT, 135.0 + east / METRES_PER_LON
    axis = tuple((float(x), float(y), 0.0) for x, y in zip(lon, lat, strict=True))
    stations = tuple(Station(id=f"S{k}", name=f"S{k}", axis_m=STATION_M * k + 500.0) for k in range(11))
    return Line(id="bench", name="bench", axis=axis, stations=stations)


def trip() -> tuple[Floats, Floats]:
    """Way and speed of a run of 20 km at 1 Hz: ten legs between stations, stops of 25 s."""
    full_mps, rise_mps2 = 22.0, 0.7
    rise_s = full_mps / rise_mps2
    ramp = np.arange(0.0, rise_s, 1.0) * rise_mps2
    cruise_s = round((STATION_M - full_mps * rise_s) / full_mps)
    leg = np.concatenate((np.zeros(25), ramp, np.full(cruise_s, full_mps), ramp[::-1]))
    leg *= STATION_M / leg.sum()
    speed = np.concatenate((np.tile(leg, 10), np.zeros(30)))
    return 500.0 + np.cumsum(speed) - speed / 2.0, speed


def write_log(path: Path, way: Alignment, runs: int) -> int:
    """A Parquet log of so many runs; gives the number of its rows."""
    place_m, speed = trip()
    n, rng = len(place_m), np.random.default_rng(1)
    lat, lon, _ = way.position(place_m)
    rows = runs * n
    columns = {
        "t_unix_s": (1.7e9 + 7200.0 * np.arange(runs)[:, None] + np.arange(n)).ravel(),
        "lat_deg": np.tile(lat, runs) + rng.normal(0.0, 5.0 / METRES_PER_LAT, rows),
        "lon_deg": np.tile(lon, runs) + rng.normal(0.0, 5.0 / METRES_PER_LON, rows),
        "speed_mps": np.abs(np.tile(speed, runs) + rng.normal(0.0, 0.15, rows)),
    }
    with duckdb.connect() as connection:
        connection.register("columns", {"run": np.repeat(np.arange(runs), n), **columns})
        connection.execute(
            "COPY (SELECT t_unix_s, lat_deg, lon_deg, speed_mps, printf('%05d', run) AS run_id FROM columns) "  # noqa: S608 - our own path
            f"TO '{path}' (FORMAT parquet)"
        )
    return rows


def projection_s(way: Alignment) -> float:
    """Time to project a million fixes at 25 m/s, up and down the line."""
    place_m = np.abs((np.arange(FIXES) * 25.0) % (2.0 * LENGTH_M - 200.0) - LENGTH_M + 100.0)
    lat, lon, _ = way.position(place_m)
    t = np.arange(FIXES, dtype=np.float64)
    project_run([way], t[:1000], lat[:1000], lon[:1000])  # compiled before the clock runs
    started = time.perf_counter()
    project_run([way], t, lat, lon)
    return time.perf_counter() - started


def analysis(line: Line, path: Path, processes: int) -> tuple[int, int, float]:
    """Runs and legs of a log, and the time it took."""
    started = time.perf_counter()
    found = [len(one.rows) for one in analysed_runs(read_runs(path), Job(line, TRAIN, {}), processes)]
    return len(found), sum(found), time.perf_counter() - started


def rows_of(rounds: int) -> list[Row]:
    """All figures."""
    line = line_of()
    way = alignment_of(line)
    rows = [Row("1 M fixes projected on 25 km, s", min(projection_s(way) for _ in range(rounds)), 0.7)]
    runs = RUNS * rounds
    with tempfile.TemporaryDirectory(prefix="kirotei-bench-") as folder:
        few, path = Path(folder, "few.parquet"), Path(folder, "runs.parquet")
        write_log(few, way, CORES)
        write_log(path, way, runs)
        _, _, starting_s = analysis(line, few, CORES)
        count, legs, took_s = analysis(line, path, CORES)
    scaled_s = starting_s + max(took_s - starting_s, 0.0) * TEN_THOUSAND / count
    rows.append(Row(f"10,000 runs of 20 km on {CORES} cores, s (from {count} runs, {legs} legs)", scaled_s, 60.0))
    memory = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    rows.append(Row("largest process, MB", memory / 1024.0, 1500.0))
    return rows


def run(*, json: bool, rounds: int) -> None:
    """Print every figure."""
    rows = rows_of(rounds)
    if json:
        told = [{**asdict(row), "reached": row.reached} for row in rows]
        print(json_text.dumps({"rows": told}, indent=1))  # noqa: T201 - the command's output
        return
    for row in rows:
        print(f"{row.figure:72}{row.value:9.2f}  <= {row.wanted:g}  {'' if row.reached else 'FALLS SHORT'}")  # noqa: T201 - the same
