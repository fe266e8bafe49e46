"""Ten seconds without the wheel on real drives: how far the fused mode's way goes wrong.

    kirotei motion import comma2k19 SEGMENT --out drive
    python -m benchmarks.coasting drive [LOG …] [--settle 15] [--every 0.5] [--from 0 --to 1] [--backwards]

A LOG is a motion log with its truth beside it. The wheel's scale is that of the whole drive against its truth: what is
asked is the inertial way. Starts lie `--every` seconds apart, the first `--settle` seconds after the log begins; the
lines give all starts, and those of the drive's first and second half. `--from` and `--to` cut the drive (shares of its
time): begun anew in motion it is another one. `--backwards` takes it from its end to its beginning, facing the other
way: brakes speed it up, bends lie on the other side, and it is as real.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from services.odometry_fusion.fused_coasting import coast_errors
from services.odometry_fusion.fused_odometry import FusedOdometry
from services.odometry_fusion.fused_settings import FusedSettings
from services.odometry_fusion.motion_log import Floats, MotionLog
from services.odometry_fusion.motion_log_file import MotionLogError, read_motion_log
from services.odometry_fusion.motion_truth_file import read_truth

SCALE_SIGMA = 0.002
HORIZON_S = 10.0


def scale_of(log: MotionLog, true_t_s: Floats, true_m: Floats) -> float:
    """True way over the wheel's, from where both have begun to where one ends."""
    ends_s = [max(log.tacho_t_s[0], true_t_s[0]), min(log.tacho_t_s[-1], true_t_s[-1])]
    wheel_m = np.diff(np.interp(ends_s, log.tacho_t_s, log.pulses * log.vehicle.metres_per_pulse))
    return float((np.diff(np.interp(ends_s, true_t_s, true_m)) / wheel_m)[0])


def cut(log: MotionLog, first: float, last: float) -> MotionLog:
    """The log between two shares of its time, its counter beginning there."""
    ends_s = log.tacho_t_s[0] + np.array([first, last]) * (log.end_s - log.tacho_t_s[0])
    imu = slice(*np.searchsorted(log.imu_t_s, ends_s).tolist())
    counts = slice(*np.searchsorted(log.tacho_t_s, ends_s).tolist())
    pulses = log.pulses[counts] - log.pulses[counts][0]
    return replace(log, imu_t_s=log.imu_t_s[imu], imu=log.imu[imu], tacho_t_s=log.tacho_t_s[counts], pulses=pulses)


def reversed_drive(log: MotionLog, true_t_s: Floats, true_m: Floats) -> tuple[MotionLog, Floats, Floats]:
    """The drive from its end to its beginning, turned about z so that it goes forwards again; and its truth.

    Time backwards turns rates over and leaves forces; half a turn about z turns x and y of both over.
    """
    end_s = max(log.end_s, float(log.imu_t_s[-1]), float(true_t_s[-1]))
    signs = np.array([-1.0, -1.0, 1.0, 1.0, 1.0, -1.0])
    turned = replace(
        log,
        imu_t_s=(end_s - log.imu_t_s)[::-1].copy(),
        imu=(log.imu * signs)[::-1].copy(),
        tacho_t_s=(end_s - log.tacho_t_s)[::-1].copy(),
        pulses=(log.pulses[-1] - log.pulses)[::-1].copy(),
    )
    return turned, (end_s - true_t_s)[::-1].copy(), (true_m[-1] - true_m)[::-1].copy()


def drive_errors(folder: Path, asked: argparse.Namespace) -> tuple[float, Floats]:
    """Wheel scale, and the errors of all starts [m]. Raises MotionLogError, OSError."""
    log, truth = read_motion_log(folder).log, read_truth(folder / "truth.parquet")
    true_t_s, true_m = truth.t_s, truth.distance_m
    if asked.backwards:
        log, true_t_s, true_m = reversed_drive(log, true_t_s, true_m)
    log = cut(log, asked.first, asked.last)
    scale = scale_of(log, true_t_s, true_m)

    def begin() -> FusedOdometry:
        step = FusedOdometry(log.vehicle, FusedSettings())
        step.update_scale(scale, SCALE_SIGMA)
        return step

    errors_m = coast_errors(log, begin, true_t_s, true_m, HORIZON_S, asked.every, asked.settle)
    return scale, np.abs(errors_m)


def words(errors_m: Floats) -> str:
    """Number of starts, median and 95 % error."""
    if not len(errors_m):
        return f"{0:6d} {'-':>7} {'-':>7}"
    return f"{len(errors_m):6d} {float(np.median(errors_m)):7.2f} {float(np.percentile(errors_m, 95.0)):7.2f}"


def main() -> None:
    """Print a line per drive, and one for all of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path, metavar="LOG")
    parser.add_argument("--settle", type=float, default=15.0, help="seconds from the log's begin to the first start")
    parser.add_argument("--every", type=float, default=0.5, help="seconds between starts")
    parser.add_argument("--from", dest="first", type=float, default=0.0, help="share of the drive left out before")
    parser.add_argument("--to", dest="last", type=float, default=1.0, help="share of the drive at which it ends")
    parser.add_argument("--backwards", action="store_true", help="from its end to its beginning")
    asked = parser.parse_args()
    part = f"{'starts':>6} {'p50 m':>7} {'p95 m':>7}"
    sys.stdout.write(f"{'drive':20} {'scale':>7} {part}   {'first half':>6}{part[10:]}   {'second':>6}{part[6:]}\n")
    every: list[Floats] = []
    for folder in asked.logs:
        try:
            scale, errors_m = drive_errors(folder, asked)
        except (MotionLogError, OSError) as error:
            parser.error(str(error))
        half = len(errors_m) // 2
        shown = "   ".join(words(one) for one in (errors_m, errors_m[:half], errors_m[half:]))
        sys.stdout.write(f"{folder.name:20} {scale:7.4f} {shown}\n")
        sys.stdout.flush()
        every.append(errors_m)
    sys.stdout.write(f"{'all':20} {'':7} {words(np.concatenate(every))}\n")


if __name__ == "__main__":
    main()
