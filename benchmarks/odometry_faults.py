"""Faults of both sensors on simulated runs with slips: whether the fused mode's bound holds all the same.

    python -m benchmarks.odometry_faults [--runs 30] [--seed 5]

Each run is ten minutes on a line of its own (±33 per mille) with a slip about every 45 s, one fault at a time drawn at
random; the wheel's scale is not known. Prints a line per fault.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import islice

import numpy as np

from benchmarks.slips import odometry_of
from services.odometry_fusion.motion_log import VALID, Floats, MotionRows
from services.simulator.motion_log import MotionLog, slip_runs
from services.simulator.motion_settings import MotionSettings
from services.simulator.random_track import TrackSettings

RUN_S = 600.0
ENDS_S = (60.0, 120.0)
"""Faults begin so long after the start and before the end."""
FAULTS = (
    "both late by 1 s",
    "both late by 2 s",
    "both late by 5 s",
    "turned left at rest",
    "turned right at rest",
    "turned left under way",
    "turned right under way",
    "begun in a slip",
    "begun under way",
)


def late(log: MotionLog, from_s: float, by_s: float) -> MotionLog:
    """Stamps of both sensors late by so much from an instant on."""
    imu_t_s, tacho_t_s = (np.where(t_s > from_s, t_s + by_s, t_s) for t_s in (log.imu_t_s, log.tacho_t_s))
    imu, tacho = imu_t_s <= log.truth_t_s[-1], tacho_t_s <= log.truth_t_s[-1]
    return replace(log, imu_t_s=imu_t_s[imu], imu=log.imu[imu], tacho_t_s=tacho_t_s[tacho], pulses=log.pulses[tacho])


def turned(log: MotionLog, from_s: float, sense: float) -> MotionLog:
    """The inertial sensor turned by a quarter about z from an instant on."""
    imu, after = log.imu.copy(), log.imu_t_s > from_s
    for x, y in ((0, 1), (3, 4)):
        imu[after, x], imu[after, y] = sense * log.imu[after, y], -sense * log.imu[after, x]
    return replace(log, imu=imu)


def begun(log: MotionLog, from_s: float) -> MotionLog:
    """The samples from an instant on alone."""
    imu, tacho = log.imu_t_s >= from_s, log.tacho_t_s >= from_s
    return replace(
        log, imu_t_s=log.imu_t_s[imu], imu=log.imu[imu], tacho_t_s=log.tacho_t_s[tacho], pulses=log.pulses[tacho]
    )


def error_of(log: MotionLog, rows: MotionRows) -> Floats:
    """Error of the distance since the first row [m]."""
    true_m = np.interp(rows.t_s, log.truth_t_s, log.distance_m)
    error_m: Floats = rows.distance_m - rows.distance_m[0] - (true_m - true_m[0])
    return error_m


def faulty(log: MotionLog, fault: str, generator: np.random.Generator) -> MotionLog | None:
    """The log with a fault; None where the run has no instant for it."""
    speed_mps, t_s = log.speed_mps, log.truth_t_s
    fits = (t_s > ENDS_S[0]) & (t_s < t_s[-1] - ENDS_S[1])
    if "rest" in fault:
        fits &= speed_mps < 0.01  # noqa: PLR2004 - at rest
    elif "slip" in fault:
        fits &= log.slip != 0
    else:
        fits &= (speed_mps > 5.0) & (log.slip == 0)  # noqa: PLR2004 - under way
    if not fits.any():
        return None
    at_s = float(generator.choice(t_s[fits]))
    if "late" in fault:
        return late(log, at_s, float(fault.split()[-2]))
    return begun(log, at_s) if "begun" in fault else turned(log, at_s, 1.0 if "left" in fault else -1.0)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--seed", type=int, default=5)
    asked = parser.parse_args()
    runs = slip_runs(asked.seed, 10**9, MotionSettings(), TrackSettings(max_gradient_permille=33.0), duration_s=RUN_S)
    sums = np.zeros((len(FAULTS), 5))
    for number, log in enumerate(islice(runs, asked.runs)):
        for k, fault in enumerate(FAULTS):
            changed = faulty(log, fault, np.random.default_rng([asked.seed, number, k]))
            if changed is None:
                continue
            rows = odometry_of(changed, "fused", known_scale=False)
            beyond_m = np.abs(error_of(log, rows)) - rows.bound_m
            broken = beyond_m > 0.0
            valid = broken & (rows.status == VALID)
            sums[k, :4] += np.array([1, broken.any(), broken.sum(), valid.sum()], np.float64)
            sums[k, 4] = max(sums[k, 4], beyond_m.max())
    print(f"{'fault':24s} {'runs':>5s} {'broken':>7s} {'rows':>7s} {'valid':>7s} {'beyond m':>9s}")  # noqa: T201 - a table for a person
    for fault, (count, broken_runs, broken_rows, valid_rows, most_m) in zip(FAULTS, sums, strict=True):
        line = (
            f"{fault:24s} {count:5.0f} {broken_runs:7.0f} {broken_rows:7.0f} {valid_rows:7.0f} {max(most_m, 0.0):9.1f}"
        )
        print(line)  # noqa: T201 - the same


if __name__ == "__main__":
    main()
