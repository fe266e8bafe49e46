"""Two receivers on the same trains: how far places, energies, best runs and running times lie apart.

    python -m benchmarks.two_receivers phone.csv ubx.csv --line line.json --vehicle vehicle.toml [--legs legs.csv]

Both logs hold the same runs under the same ids. Each is analysed by itself, with the same settings, and compared leg by
leg where both count. `place`: the smoothed place of the one against that of the other, at the fixes of the first,
from departure to arrival; `aligned`: after the best shift of the clocks of each run. `margin`: (mean − minimum)/mean of
the energy of all runs of a section, both directions together, as Maki et al.; the same best run chosen, the difference
in points, and what the first receiver's choice costs above the other's by the other's energies. `--legs`: running times
to compare the first receiver with (run_id, from, to, running_time_s).
"""

from __future__ import annotations

import argparse
import csv
import json
from collections import defaultdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from services.line.alignment import alignment_of, routes
from services.line.line_file import load_line
from services.run_history.run_analysis import LegRun, analyse_run
from services.run_history.runs_log_file import read_runs
from services.run_history.vehicle import Vehicle
from services.run_history.vehicle_file import read_vehicle

Floats = NDArray[np.float64]
Key = tuple[str, str, str]
Pair = tuple[LegRun, LegRun]
SHIFTS_S = np.arange(-2.0, 2.001, 0.05)
FEWEST = 3


def legs_of(log: Path, line: Path, vehicle: Vehicle) -> dict[Key, LegRun]:
    """Legs of a log by run, from, to; the last one where a train ran twice. Raises what is wrong with the files."""
    whole = load_line(line).line
    ways = [alignment_of(whole, branch) for branch in routes(whole)]
    return {
        (leg.run_id, leg.start.name, leg.end.name): leg
        for run in read_runs(log)
        for leg in analyse_run(run, ways, whole.stations, vehicle).legs
    }


def places(pairs: list[Pair]) -> dict[str, float]:
    """How far places lie apart [m], as they are and with the clocks of each run brought together."""
    by_run: dict[str, list[Pair]] = defaultdict(list)
    for one, other in pairs:
        by_run[one.run_id].append((one, other))
    plain, aligned = [], []
    for run in by_run.values():
        shifted = [np.concatenate([_apart(one, other, float(shift)) for one, other in run]) for shift in SHIFTS_S]
        plain.append(shifted[len(SHIFTS_S) // 2])
        aligned.append(min(shifted, key=lambda apart: float(np.median(apart))))
    return {f"place_{name}": value for name, value in _spread(np.concatenate(plain)).items()} | {
        f"aligned_{name}": value for name, value in _spread(np.concatenate(aligned)).items()
    }


def _apart(one: LegRun, other: LegRun, shift_s: float) -> Floats:
    inside = (one.t_s > one.ends.departure_s) & (one.t_s < one.ends.arrival_s)
    inside &= (one.t_s > other.t_s[0]) & (one.t_s < other.t_s[-1])
    return np.abs(one.way_m - np.interp(one.t_s + shift_s, other.t_s, other.way_m))[inside]


def _spread(values: Floats) -> dict[str, float]:
    return {"median": float(np.median(values)), "p95": float(np.percentile(values, 95.0))}


def energies(pairs: list[Pair]) -> dict[str, float]:
    """How far energies lie apart [%], and the median with its sign."""
    off = 100.0 * np.array([one.energy.traction_kwh / other.energy.traction_kwh - 1.0 for one, other in pairs])
    return {f"energy_{name}": value for name, value in _spread(np.abs(off)).items()} | {
        "energy_bias": float(np.median(off))
    }


def margins(pairs: list[Pair]) -> dict[str, float]:
    """Sections with three runs or more: how many have the same best run, and how far margins lie apart [points]."""
    sections: dict[tuple[str, ...], list[tuple[float, float]]] = defaultdict(list)
    for one, other in pairs:
        section = tuple(sorted((one.start.name, one.end.name)))
        sections[section].append((one.energy.traction_kwh, other.energy.traction_kwh))
    found = [np.array(rows) for rows in sections.values() if len(rows) >= FEWEST]
    best = [rows.argmin(axis=0) for rows in found]
    margin = [100.0 * (1.0 - rows.min(axis=0) / rows.mean(axis=0)) for rows in found]
    dearer = [100.0 * (rows[mine, 1] / rows[theirs, 1] - 1.0) for rows, (mine, theirs) in zip(found, best, strict=True)]
    return {
        "sections": len(found),
        "same_best": sum(bool(mine == theirs) for mine, theirs in best),
        "margin_apart_median": float(np.median([abs(mine - theirs) for mine, theirs in margin])),
        "choice_dearer_most": float(max(dearer)),
    }


def running_times(legs: dict[Key, LegRun], path: Path) -> dict[str, float]:
    """Running times against a table [s]: root mean square, bias, 95 %, and the share of its legs left out [%]."""
    with path.open(encoding="utf-8") as file:
        wanted = {(row["run_id"], row["from"], row["to"]): float(row["running_time_s"]) for row in csv.DictReader(file)}
    used = [key for key in wanted if key in legs and not legs[key].excluded_because]
    off = np.array([legs[key].running_time_s - wanted[key] for key in used])
    return {
        "time_rmse": float(np.sqrt(np.mean(off**2))),
        "time_bias": float(off.mean()),
        "time_p95": float(np.percentile(np.abs(off), 95.0)),
        "time_left_out": 100.0 * (1.0 - len(used) / len(wanted)),
    }


def main() -> None:
    """Print the figures as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=Path)
    parser.add_argument("second", type=Path)
    parser.add_argument("--line", type=Path, required=True)
    parser.add_argument("--vehicle", type=Path, required=True)
    parser.add_argument("--legs", type=Path)
    told = parser.parse_args()
    train = read_vehicle(told.vehicle)
    first, second = (legs_of(log, told.line, train) for log in (told.first, told.second))
    pairs = [
        (first[key], second[key])
        for key in first
        if key in second and not first[key].excluded_because and not second[key].excluded_because
    ]
    if not pairs:
        parser.error("no leg counts in both logs")
    figures = {"legs": float(len(pairs)), **places(pairs), **energies(pairs), **margins(pairs)}
    if told.legs is not None:
        figures |= running_times(first, told.legs)
    print(json.dumps({name: round(value, 2) for name, value in figures.items()}, indent=1))  # noqa: T201 - a command


if __name__ == "__main__":
    main()
