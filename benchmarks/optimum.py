"""The optimum: how long a section takes to solve, and that no observed run is cheaper under the same limits.

    python -m benchmarks.optimum [TRACK.json …] [--log LOG --line LINE --vehicle VEHICLE [--cheapest]]

Processor time is told, on a grid of 10 m: 8 km of level line, and the first section of each TRACK (TTOBench's form),
for running times 3, 10 and 20 % above the shortest. With a log, each leg that counts is set against the optimum of its
own running time under its own limits (`observed_limits`), once with the speeds of all runs as limits where the line
knows none, and once with its own alone, the narrowest limits that there are.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas.line import Line
from services.line.alignment import alignment_of, routes
from services.line.line_file import load_line
from services.run_history.observed_limits import same_limits
from services.run_history.optimum import STEP_M, OptimumError, Section, fastest_run, optimum
from services.run_history.run_analysis import LegRun, analyse_run
from services.run_history.runs_log_file import read_runs
from services.run_history.speed_trace import trace_of
from services.run_history.vehicle import Vehicle
from services.run_history.vehicle_file import read_vehicle

Floats = NDArray[np.float64]
LEVEL_M = 8000.0
SLACKS = (1.03, 1.10, 1.20)
WANTED_S = 2.0
TRAIN = Vehicle(name="bench", mass_t=120.0, max_speed_mps=44.0, max_power_kw=2000.0)


@dataclass(frozen=True, slots=True)
class Solved:
    """A section and its processor time."""

    name: str
    length_m: float
    running_time_s: float
    traction_kwh: float
    cpu_s: float


@dataclass(frozen=True, slots=True)
class Compared:
    """A leg that was run, and the optimum of its running time."""

    name: str
    share: float | None
    """Energy of the optimum over that of the run, less 1; None where no run is so fast within the limits."""
    alone: bool
    """Limits from this run alone."""


def level_section() -> Section:
    """8 km without gradients."""
    count = int(LEVEL_M / STEP_M) + 1
    return Section(np.linspace(0.0, LEVEL_M, count), np.zeros(count), np.full(count, 30.0))


def track_section(track: dict[str, Any]) -> Section:
    """The first section of a TTOBench track for TRAIN."""
    first, last = track["stops"]["values"][:2]
    count = int(np.ceil((last - first) / STEP_M)) + 1
    axis = np.linspace(first, last, count)

    def along(key: str, otherwise: float) -> Floats:
        rows = np.array([row[:2] for row in track.get(key, {"values": [[0.0, otherwise]]})["values"]], float)
        return np.asarray(rows[np.searchsorted(rows[:, 0], axis, side="right") - 1, 1])

    limit = np.minimum(along("speed limits", np.inf) / 3.6, TRAIN.max_speed_mps)
    return Section(axis, TRAIN.track_force_n(along("gradients", 0.0), 0.0), limit)


def solved(name: str, section: Section) -> Iterator[Solved]:
    """Times of a section, after one that compiles."""
    fastest_s = fastest_run(section, TRAIN).running_time_s
    optimum(section, TRAIN, fastest_s * SLACKS[0])
    for slack in SLACKS:
        begin = time.process_time()
        found = optimum(section, TRAIN, fastest_s * slack)
        cpu_s = time.process_time() - begin
        length = float(section.axis_m[-1] - section.axis_m[0])
        yield Solved(name, length, found.running_time_s, found.traction_kwh, cpu_s)


def compared(line: Line, vehicle: Vehicle, log: Path, *, cheapest: bool = False) -> Iterator[Compared]:
    """Every leg of a log that counts, or the cheapest of each section, against its optimum."""
    ways = [alignment_of(line, branch) for branch in routes(line)]
    sections: dict[tuple[str, str], list[LegRun]] = defaultdict(list)
    for run in read_runs(log):
        for leg in analyse_run(run, ways, line.stations, vehicle).legs:
            if not leg.excluded_because:
                sections[leg.start.name, leg.end.name].append(leg)
    for (start, end), legs in sections.items():
        traces = [trace_of(leg) for leg in legs]
        sign = 1.0 if legs[0].direction == "up" else -1.0
        best = min(leg.energy.traction_kwh for leg in legs)
        for number, leg in enumerate(legs):
            if cheapest and leg.energy.traction_kwh > best:
                continue
            for alone in (False, True):
                seen, own = ([traces[number]], 0) if alone else (traces, number)
                limits = same_limits(ways[0], vehicle, seen, own, leg.start.axis_m, sign)
                try:
                    kwh = optimum(limits.section, limits.vehicle, leg.running_time_s).traction_kwh
                    share = kwh / leg.energy.traction_kwh - 1.0
                except OptimumError:
                    share = None
                yield Compared(f"{start} - {end} {leg.run_id}", share, alone)


def summary_lines(found: Sequence[Compared]) -> Iterator[str]:
    """Counts, median and highest share of both kinds of limits."""
    for alone, words in ((False, "speeds of all runs"), (True, "the run's own speeds")):
        shares = [one.share for one in found if one.alone == alone]
        told = np.array([share for share in shares if share is not None])
        above, none = int((told > 0.0).sum()), len(shares) - len(told)
        yield (
            f"limits where none is known: {words}; {len(shares)} legs, optimum above the run {above}, "
            f"none found {none}, median {100 * np.median(told):+.1f} %, highest {100 * told.max():+.1f} %"
        )


def main() -> None:
    """Print both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tracks", nargs="*", type=Path)
    parser.add_argument("--log", type=Path)
    parser.add_argument("--line", type=Path)
    parser.add_argument("--vehicle", type=Path)
    parser.add_argument("--cheapest", action="store_true", help="the cheapest leg of each section alone")
    wanted = parser.parse_args()
    named = [("level", level_section())]
    named += [(path.stem, track_section(json.loads(path.read_text("utf-8")))) for path in wanted.tracks]
    for name, section in named:
        for one in solved(name, section):
            sys.stdout.write(
                f"{one.name:<28}{one.length_m / 1000:6.1f} km{one.running_time_s:8.1f} s{one.traction_kwh:8.2f} kWh"
                f"{one.cpu_s:7.2f} s of processor time (wanted {WANTED_S:g})\n"
            )
    if wanted.log is not None and wanted.line is not None and wanted.vehicle is not None:
        line, vehicle = load_line(wanted.line).line, read_vehicle(wanted.vehicle)
        for text in summary_lines(list(compared(line, vehicle, wanted.log, cheapest=wanted.cheapest))):
            sys.stdout.write(f"{text}\n")


if __name__ == "__main__":
    main()
