"""Landmarks over whole simulated runs: how far exit crossings spread from run to run, and their error against truth.

    python -m benchmarks.landmark_runs [--runs 8] [--seed 1] [--method fused] [--slips]

Runs over the demo line both ways at 40 to 70 km/h, drawn anew each time (driver, wheel, sensor; `curves_only` of
docs/simulator.md), matched from a start known within 20 m. `--slips`: a slip about every 90 s of effort, too.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass, field
from typing import Literal

import msgspec
import numpy as np

from schemas.line import Direction
from services.landmark_matching.line_landmarks import line_landmarks
from services.landmark_matching.run_matching import Start, match_run
from services.landmark_matching.run_readings import readings_of
from services.landmark_matching.settings import MatchSettings
from services.line.alignment import alignment_of
from services.line.built_in_file import built_in_line
from services.odometry_fusion.methods import run_log
from services.odometry_fusion.motion_log import MotionLog
from services.odometry_fusion.settings import Config
from services.simulator.motion_log import MotionLog as Simulated
from services.simulator.motion_log import simulate_motion_log
from services.simulator.scenario_file import read_any_scenario
from services.simulator.train_route import route_of
from services.simulator.train_scenario import Journey, TrainScenario

SPEEDS_KMH = (40, 50, 60, 70)
START_BOUND_M = 20.0
WAYS: tuple[Direction, Direction] = ("up", "down")


@dataclass
class Found:
    """What matches said, over all runs."""

    errors_m: dict[str, list[float]] = field(default_factory=dict)
    """By landmark: place by the match minus the true one, in the direction of running."""
    groups_m: dict[tuple[str, int], list[float]] = field(default_factory=dict)
    """By direction and speed [km/h, rounded down to tens]."""
    bounds_m: list[float] = field(default_factory=list)
    beyond: int = 0
    refused: Counter[str] = field(default_factory=Counter)


def _log(run: Simulated) -> MotionLog:
    return MotionLog(
        run.imu_t_s,
        np.ascontiguousarray(run.imu),
        run.tacho_t_s,
        run.pulses,
        run.pulses_per_revolution,
        run.wheel_diameter_m,
        run.imu_latency_s,
        run.max_gradient_permille,
    )


def _run(found: Found, direction: Direction, seed: int, config: Config, *, slips: bool) -> None:
    scenario = read_any_scenario("curves_only")
    if not isinstance(scenario, TrainScenario):
        raise TypeError(scenario)
    stops = [one.id for one in built_in_line("demo").stations]
    journey = Journey(direction=direction, stops=(stops[0], stops[-1]))
    route = route_of(alignment_of(built_in_line("demo")), journey)
    settings = scenario.motion
    if slips:
        settings = msgspec.structs.replace(
            settings, adhesion=msgspec.structs.replace(settings.adhesion, random_gap_s=90.0)
        )
    log = simulate_motion_log(
        route.track, settings, np.random.default_rng([seed, direction == "up"]), start_m=route.start_m
    )
    rows = run_log(_log(log), config)
    known = line_landmarks(built_in_line("demo"))
    start = Start("", direction, route.axis_of(float(log.way_m[0]), 0), START_BOUND_M)
    matches = match_run(readings_of(rows), known, start, MatchSettings(), rows.share_bound).matches
    sign = 1.0 if direction == "up" else -1.0
    for match in matches:
        if not match.accepted:
            found.refused[match.kind] += 1
            continue
        true_m = route.axis_of(float(np.interp(match.t_s, log.truth_t_s, log.way_m)), 0)
        error_m = sign * (match.axis_m - true_m)
        speed_kmh = 3.6 * float(np.interp(match.t_s, log.truth_t_s, log.speed_mps))
        found.errors_m.setdefault(match.landmark.id, []).append(error_m)
        found.groups_m.setdefault((direction, 10 * int(speed_kmh // 10)), []).append(error_m)
        found.bounds_m.append(match.bound_m)
        found.beyond += abs(error_m) > match.bound_m


def measure(runs: int, seed: int, method: Literal["fused", "paper"], *, slips: bool) -> Found:
    """`runs` each way, the same for the same seed."""
    found = Found()
    for number in range(runs):
        for direction in WAYS:
            _run(found, direction, seed * 1000 + number, Config(method=method), slips=slips)
    return found


def words(found: Found) -> str:
    """The table."""
    lines = [f"{'direction, km/h':<20}{'passes':>7}{'mean':>8}{'std':>7}{'largest':>9}  [m]"]
    for (direction, speed), errors in sorted(found.groups_m.items()):
        spread = f"{np.std(errors, ddof=1):>7.2f}" if len(errors) > 1 else f"{'':>7}"
        name = f"{direction} {speed} to {speed + 10}"
        lines.append(f"{name:<20}{len(errors):>7}{np.mean(errors):>+8.2f}{spread}{np.max(np.abs(errors)):>9.2f}")
    spreads = [float(np.std(errors, ddof=1)) for errors in found.errors_m.values() if len(errors) > 2]  # noqa: PLR2004 - two show no spread
    everything = [error for errors in found.errors_m.values() for error in errors]
    lines.append(
        f"spread per curve, each way ({len(spreads)}): median {np.median(spreads):.2f}, largest {max(spreads):.2f} m"
    )
    lines.append(
        f"accepted {len(everything)}, above the bound {found.beyond} (median bound {np.median(found.bounds_m):.1f} m); "
        f"refused {dict(found.refused.most_common())}"
    )
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", choices=("fused", "paper"), default="fused")
    parser.add_argument("--slips", action="store_true")
    given = parser.parse_args()
    print(words(measure(given.runs, given.seed, given.method, slips=given.slips)))  # noqa: T201 - the command's output
