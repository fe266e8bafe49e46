"""The paper's method with its switches one by one, over logs with known truth.

    python -m benchmarks.paper_variants LOG [LOG …]
    python -m benchmarks.paper_variants [--slips 100] [--seed 1] [--gradient 16]

A LOG is a motion log with its truth beside it. Without any, runs of half an hour are simulated (services/simulator) on
lines as steep as told. Judged as docs/odometry_fusion.md says; prints a table in Markdown, a row as soon as it is done.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from services.odometry_fusion.evaluation import (
    WITHIN_M,
    MotionTrack,
    MotionTruth,
    WheelWay,
    error_of,
    false_triggers,
    lag_of,
    slip_results,
)
from services.odometry_fusion.methods import run_log
from services.odometry_fusion.motion_log import STATUSES, MotionLog
from services.odometry_fusion.motion_log_file import MotionLogError, read_motion_log
from services.odometry_fusion.motion_truth_file import read_truth
from services.odometry_fusion.paper_settings import PaperSettings
from services.odometry_fusion.settings import Config
from services.simulator.motion_log import slip_runs
from services.simulator.random_track import TrackSettings


class Case(NamedTuple):
    """A log and what the train really did."""

    log: MotionLog
    truth: MotionTruth


def _paper(settings: PaperSettings) -> Config:
    return Config(method="paper", paper=settings)


VARIANTS: dict[str, Config] = {
    "wheel alone": Config(method="wheel"),
    "pitch rate as measured (`none`)": _paper(PaperSettings(pitch_correction="none")),
    "pitch constant (`constant`)": _paper(PaperSettings(pitch_correction="constant")),
    "**equation (5), four start points (default)**": _paper(PaperSettings()),
    "equation (12) (`yaw_and_roll`)": _paper(PaperSettings(pitch_correction="yaw_and_roll")),
    "one start point": _paper(PaperSettings(start_points=1)),
    "jerk test at re-adhesion": _paper(PaperSettings(jerk_at_readhesion=True)),
    "no look-back": _paper(PaperSettings(look_back_s=0.0)),
    "Ta 1.23 km/h/s": _paper(PaperSettings(detection_kmhps=1.23)),
    "β 0.3 km/h/s": _paper(PaperSettings(beta_kmhps=0.3)),
}
HEADER = (
    "| variant | slips | > 1 m | re-adhesion | within ±2 % | 95 % | false /h | rows beyond bound | above 5 m + 5 % |\n"
    "|---|---|---|---|---|---|---|---|---|"
)


class Figures(msgspec.Struct):
    """Sums over logs."""

    errors_m: list[float] = msgspec.field(default_factory=list)
    counted: int = 0
    readhered: int = 0
    false: int = 0
    hours: float = 0.0
    violations: int = 0
    above: int = 0
    rows: int = 0

    def line(self, name: str) -> str:
        """A row of the table."""
        errors_m = np.array(self.errors_m)
        met = f"{100.0 * self.readhered / self.counted:.1f} %" if self.counted and name != "wheel alone" else "–"
        within = f"{100.0 * float((errors_m <= WITHIN_M).mean()):.1f} %" if len(errors_m) else "–"
        p95 = f"{float(np.percentile(errors_m, 95.0)):.1f} m" if len(errors_m) else "–"
        return (
            f"| {name} | {len(errors_m)} | {self.counted} | {met} | {within} | {p95} | {self.false / self.hours:.1f} |"
            f" {self.violations} | {100.0 * self.above / self.rows:.1f} % |"
        )


def judge(case: Case, config: Config, figures: Figures) -> None:
    """Add one log to the figures."""
    rows = run_log(case.log, config)
    status = tuple(STATUSES[code] for code in rows.status.tolist())
    track = MotionTrack("run", rows.t_s, rows.distance_m, rows.speed_mps, rows.slip != 0, rows.bound_m, status)
    wheel = WheelWay(case.log.tacho_t_s, case.log.pulses.astype(np.float64) * case.log.vehicle.metres_per_pulse)
    lag_s = lag_of(track, case.truth)
    for one in slip_results(track, case.truth, wheel, lag_s):
        figures.errors_m.append(one.error_m)
        if one.cost_m > 1.0:
            figures.counted += 1
            figures.readhered += one.adheres
    figures.false += len(false_triggers(track, case.truth, lag_s))
    figures.hours += float(rows.t_s[-1] - rows.t_s[0]) / 3600.0
    figures.violations += int((~(np.abs(error_of(track, case.truth)) <= rows.bound_m)).sum())
    figures.above += int((rows.bound_m > 5.0 + 0.05 * np.abs(rows.distance_m - rows.distance_m[0])).sum())
    figures.rows += len(rows)


def given(folder: Path) -> Case:
    """A log with the truth beside it. Raises MotionLogError, OSError."""
    for name in ("truth.parquet", "truth.csv"):
        if (folder / name).is_file():
            return Case(read_motion_log(folder).log, read_truth(folder / name))
    raise MotionLogError(folder, "neither truth.parquet nor truth.csv is there")


def simulated(slips: int, seed: int, gradient_permille: float) -> list[Case]:
    """Simulated runs with so many slips."""
    cases = []
    for run in slip_runs(seed, slips, track=TrackSettings(max_gradient_permille=gradient_permille)):
        log = MotionLog(
            run.imu_t_s,
            np.ascontiguousarray(run.imu),
            run.tacho_t_s,
            run.pulses,
            run.pulses_per_revolution,
            run.wheel_diameter_m,
            run.imu_latency_s,
            run.max_gradient_permille,
        )
        truth = MotionTruth(run.truth_t_s, run.distance_m, run.speed_mps, run.slip.astype(np.int64))
        cases.append(Case(log, truth))
    return cases


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path, metavar="LOG", help="motion logs; without any, simulated ones")
    parser.add_argument("--slips", type=int, default=100, help="of simulated logs")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--gradient", type=float, default=16.0, help="per mille, of simulated lines")
    asked = parser.parse_args()
    try:
        cases = [given(folder) for folder in asked.logs] or simulated(asked.slips, asked.seed, asked.gradient)
    except (MotionLogError, OSError) as error:
        parser.error(str(error))
    sys.stdout.write(HEADER + "\n")
    for name, config in VARIANTS.items():
        figures = Figures()
        for case in cases:
            judge(case, config, figures)
        sys.stdout.write(figures.line(name) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
