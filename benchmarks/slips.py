"""Simulated slips by the thousand: what the modes of odometry make of them, condition by condition.

    python -m benchmarks.slips [--slips 1000] [--seed 1] [--method fused] [--kinds cycling …] [--creep 1] [--top MPS]
        [CONDITION …]

Every condition has runs of half an hour on lines of their own (services/simulator), judged as docs/odometry_fusion.md
says. Prints a line per condition as soon as it is done.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Literal, NamedTuple

import msgspec
import numpy as np

from services.odometry_fusion.evaluation import (
    MotionTrack,
    MotionTruth,
    SlipSpan,
    WheelWay,
    error_of,
    false_triggers,
    lag_of,
    slip_results,
)
from services.odometry_fusion.fused_odometry import FusedOdometry
from services.odometry_fusion.fused_settings import FusedSettings
from services.odometry_fusion.motion_log import STATUSES, MotionRows, OdometryStep, Vehicle
from services.odometry_fusion.paper_odometry import PaperOdometry
from services.odometry_fusion.paper_settings import PaperSettings
from services.simulator.motion_log import MotionLog, slip_runs
from services.simulator.motion_settings import Adhesion, Imu, MotionSettings, SlipKind, Tacho
from services.simulator.random_track import TrackSettings
from services.simulator.slip_episodes import KINDS

MethodName = Literal["fused", "paper"]
RUN_S = 1_800.0


class Condition(NamedTuple):
    """What is disturbed, and how steep the line is."""

    settings: MotionSettings = MotionSettings()
    gradient_permille: float = 16.0
    known_scale: bool = True
    """The wheel's scale has been found at landmarks; else it goes into the errors, which are those of slips no more."""


CONDITIONS: dict[str, Condition] = {
    "16 permille": Condition(),
    "33 permille": Condition(gradient_permille=33.0),
    "micro-slip x3": Condition(MotionSettings(adhesion=Adhesion(micro_slip=3.0))),
    "long micro-slip": Condition(MotionSettings(adhesion=Adhesion(build_up=3.0))),
    "fast micro-slip": Condition(MotionSettings(adhesion=Adhesion(build_up_speed=3.0))),
    "gyro 0.05 deg/s": Condition(MotionSettings(imu=Imu(gyro_bias_dps=0.05))),
    "accelerometer 0.1 m/s2": Condition(MotionSettings(imu=Imu(accelerometer_bias_mps2=0.1))),
    "vibration x2": Condition(MotionSettings(imu=Imu(vibration=2.0))),
    "mounting 1 deg": Condition(MotionSettings(imu=Imu(mounting_deg=(1.0, 1.0, 1.0)))),
    "wheel 1 %": Condition(MotionSettings(tacho=Tacho(wheel_scale=0.01))),
    "wheel -2 %": Condition(MotionSettings(tacho=Tacho(wheel_scale=-0.02)), gradient_permille=33.0, known_scale=False),
    "100 Hz counts": Condition(MotionSettings(tacho=Tacho(rate_hz=100))),
    "33 permille, unknown": Condition(gradient_permille=33.0, known_scale=False),
    "mems": Condition(MotionSettings(imu=Imu(grade="mems"))),
}


class Figures(msgspec.Struct):
    """Sums over the runs of a condition."""

    errors_m: list[float] = msgspec.field(default_factory=list)
    counted: int = 0
    readhered: int = 0
    early: int = 0
    undetected: int = 0
    false: int = 0
    hours: float = 0.0
    violations: int = 0
    over: int = 0
    rows: int = 0
    worst: float = 0.0
    """Largest error over its bound."""

    def line(self, name: str) -> str:
        """A line of the table."""
        p50, p95 = np.percentile(np.abs(self.errors_m), (50, 95)) if self.errors_m else (np.nan, np.nan)
        most = max(np.abs(self.errors_m), default=np.nan)
        share = 100.0 * self.readhered / max(self.counted, 1)
        return (
            f"{name:24s} {len(self.errors_m):6d} {self.counted:6d} {share:9.2f} {self.early:5d} {self.undetected:6d}"
            f" {p50:6.2f} {p95:6.2f} {most:7.2f} {self.false / max(self.hours, 1e-9):8.2f} {self.violations:6d}"
            f" {self.over:5d} {self.worst:6.2f}"
        )


HEADER = (
    f"{'condition':24s} {'slips':>6s} {'> 1 m':>6s} {'readh. %':>9s} {'early':>5s} {'missed':>6s}"
    f" {'p50 m':>6s} {'p95 m':>6s} {'max m':>7s} {'false/h':>8s} {'viol.':>6s} {'over':>5s} {'ratio':>6s}"
)


def odometry_of(log: MotionLog, method: MethodName, *, known_scale: bool) -> MotionRows:
    """Rows of a simulated log."""
    vehicle = Vehicle(log.pulses_per_revolution, log.wheel_diameter_m, log.imu_latency_s, log.max_gradient_permille)
    step: OdometryStep
    if method == "paper":
        step = PaperOdometry(vehicle, PaperSettings())
    else:
        fused = FusedOdometry(vehicle, FusedSettings())
        if known_scale:
            fused.update_scale(log.true_wheel_diameter_m / log.wheel_diameter_m, 0.001)
        step = fused
    imu = np.ascontiguousarray(log.imu)
    return step.advance(float(log.truth_t_s[-1]), log.imu_t_s, imu, log.tacho_t_s, log.pulses)


def judge(log: MotionLog, rows: MotionRows, figures: Figures, least_top_mps: float = 0.0) -> None:
    """Add one run to the figures; slips in which the rim is never off by so much count for bounds alone."""
    status = tuple(STATUSES[code] for code in rows.status)
    track = MotionTrack("run", rows.t_s, rows.distance_m, rows.speed_mps, rows.slip != 0, rows.bound_m, status)
    truth = MotionTruth(log.truth_t_s, log.distance_m, log.speed_mps, log.slip.astype(np.int64))
    pulse_m = float(np.pi * log.true_wheel_diameter_m / log.pulses_per_revolution)
    wheel = WheelWay(log.tacho_t_s, log.pulses.astype(np.float64) * pulse_m)
    lag_s = lag_of(track, truth)
    for one in slip_results(track, truth, wheel, lag_s):
        if top_mps(log, one.span) < least_top_mps:
            continue
        figures.errors_m.append(float(one.error_m))
        if abs(one.cost_m) > 1.0:
            figures.counted += 1
            figures.readhered += one.adheres
            figures.early += one.early
            figures.undetected += not one.detected
    error_m = np.abs(error_of(track, truth))
    figures.false += len(false_triggers(track, truth, lag_s))
    figures.hours += float(rows.t_s[-1] - rows.t_s[0]) / 3600.0
    figures.violations += int((~(error_m <= rows.bound_m)).sum())
    figures.over += int((rows.bound_m > 5.0 + 0.05 * (rows.distance_m - rows.distance_m[0]) + 1e-9).sum())
    figures.rows += len(rows)
    figures.worst = max(figures.worst, float((error_m / rows.bound_m).max()))


def top_mps(log: MotionLog, span: SlipSpan) -> float:
    """Largest slip speed of the rim in a slip, either way."""
    within = (log.truth_t_s >= span.start_s) & (log.truth_t_s <= span.end_s)
    return float(np.abs(np.gradient(log.wheel_slip_m, log.truth_t_s))[within].max(initial=0.0))


def runs(
    condition: Condition, slips: int, seed: int, kinds: list[SlipKind] | None = None, creep: float = 1.0
) -> Iterator[MotionLog]:
    """Simulated runs with so many slips, of some kinds alone or of those drawn by default.

    Wheels that adhere creep by so many times what the condition says.
    """
    adhesion = condition.settings.adhesion
    weights = adhesion.weights if kinds is None else {kind: adhesion.weights.get(kind, 1.0) for kind in kinds}
    adhesion = msgspec.structs.replace(adhesion, weights=weights, micro_slip=creep * adhesion.micro_slip)
    settings = msgspec.structs.replace(condition.settings, adhesion=adhesion)
    track = TrackSettings(max_gradient_permille=condition.gradient_permille)
    return slip_runs(seed, slips, settings, track, duration_s=RUN_S)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--slips", type=int, default=1_000, help="per condition")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", choices=("fused", "paper"), default="fused")
    parser.add_argument(
        "--kinds", nargs="+", choices=KINDS, default=None, help="of slips; all but breaking_away when left out"
    )
    parser.add_argument("--creep", type=float, default=1.0, help="of adhering wheels, times the usual; 0: none")
    parser.add_argument(
        "--top", type=float, default=0.0, metavar="MPS", help="only slips in which the rim comes to so much slip speed"
    )
    known = ", ".join(CONDITIONS).replace("%", "%%")
    parser.add_argument("conditions", nargs="*", metavar="CONDITION", help=f"of {known}; default: all")
    asked = parser.parse_args()
    unknown = [name for name in asked.conditions if name not in CONDITIONS]
    if unknown:
        parser.error(f"no condition {unknown[0]!r}")
    print(HEADER, flush=True)  # noqa: T201 - this is a table for a person
    for name in asked.conditions or CONDITIONS:
        figures = Figures()
        for log in runs(CONDITIONS[name], asked.slips, asked.seed, asked.kinds, asked.creep):
            judge(log, odometry_of(log, asked.method, known_scale=CONDITIONS[name].known_scale), figures, asked.top)
        print(figures.line(name), flush=True)  # noqa: T201 - the same


if __name__ == "__main__":
    main()
