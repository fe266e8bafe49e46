"""Motion logs with known truth, given or simulated, and how odometry of them is judged, for the tables beside this."""

from __future__ import annotations

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
from services.odometry_fusion.motion_log import STATUSES, VALID, MotionLog
from services.odometry_fusion.motion_log_file import MotionLogError, read_motion_log
from services.odometry_fusion.motion_truth_file import read_truth
from services.odometry_fusion.settings import Config
from services.simulator.motion_log import slip_runs
from services.simulator.random_track import TrackSettings

HEADER = (
    "| variant | slips | > 1 m | re-adhesion | within ±2 % | 95 % | false /h"
    " | rows beyond bound | above 5 m + 5 % | not valid |\n"
    "|---|---|---|---|---|---|---|---|---|---|"
)


class Case(NamedTuple):
    """A log and what the train really did."""

    log: MotionLog
    truth: MotionTruth


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
    degraded: int = 0
    tells_slips: bool = True
    """Whether the method corrects slips at all."""

    def line(self, name: str) -> str:
        """A row of the table."""
        errors_m = np.array(self.errors_m)
        met = f"{100.0 * self.readhered / self.counted:.1f} %" if self.counted and self.tells_slips else "–"
        within = f"{100.0 * float((errors_m <= WITHIN_M).mean()):.1f} %" if len(errors_m) else "–"
        p95 = f"{float(np.percentile(errors_m, 95.0)):.1f} m" if len(errors_m) else "–"
        return (
            f"| {name} | {len(errors_m)} | {self.counted} | {met} | {within} | {p95} | {self.false / self.hours:.1f} |"
            f" {self.violations} | {100.0 * self.above / self.rows:.1f} % | {100.0 * self.degraded / self.rows:.1f} % |"
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
    figures.degraded += int((rows.status != VALID).sum())
    figures.tells_slips = config.method != "wheel"


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
