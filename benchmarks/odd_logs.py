"""Logs that are not as they should be: what odometry makes of them, and whether its bound holds.

    python -m benchmarks.odd_logs LOG [LOG …] [--method paper] [--only VARIANT]
    python -m benchmarks.odd_logs [--slips 150] [--seed 1] [--gradient 16] [--method paper]

A LOG is a motion log with its truth beside it; without any, logs are simulated. Each is spoilt in the ways named
below, always alike, and judged as docs/odometry_fusion.md says. Prints a table in Markdown.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.odometry_cases import HEADER, Case, Figures, given, judge, simulated
from services.odometry_fusion.evaluation import MotionTruth
from services.odometry_fusion.motion_log import Floats
from services.odometry_fusion.motion_log_file import MotionLogError
from services.odometry_fusion.settings import Config

SEED = 3
RUNNING_MPS = 5.0
FULL_SHARE = 0.8
"""Of the largest speed: full run."""
INTO_SLIP_S = 2.0


def _restamped(case: Case, t_s: Floats) -> Case:
    """The same counts at other times; those that no longer rise are left out."""
    rising: Floats = np.maximum.accumulate(t_s)
    kept = np.r_[True, np.diff(rising) > 0.0]
    return Case(replace(case.log, tacho_t_s=rising[kept], pulses=case.log.pulses[kept]), case.truth)


def jitter(sigma_s: float, *, late: bool = False) -> Callable[[Case], Case]:
    """Stamps of the counts that jitter, to both sides or (`late`) to one."""

    def spoil(case: Case) -> Case:
        off_s = np.random.default_rng(SEED).normal(0.0, sigma_s, len(case.log.tacho_t_s))
        return _restamped(case, case.log.tacho_t_s + (np.abs(off_s) if late else off_s))

    return spoil


def latency(by_s: float) -> Callable[[Case], Case]:
    """The inertial sensor's latency stated wrongly."""
    return lambda case: Case(replace(case.log, imu_latency_s=max(0.0, case.log.imu_latency_s + by_s)), case.truth)


def wheel(factor: float) -> Callable[[Case], Case]:
    """The wheel's diameter stated wrongly."""
    return lambda case: Case(replace(case.log, wheel_diameter_m=case.log.wheel_diameter_m * factor), case.truth)


def _cut(case: Case, first_s: float, last_s: float = np.inf) -> Case:
    def within(t_s: Floats) -> NDArray[np.bool_]:
        return (t_s >= first_s) & (t_s <= last_s)

    log, truth = case.log, case.truth
    imu, tacho, true = within(log.imu_t_s), within(log.tacho_t_s), within(truth.t_s)
    return Case(
        replace(
            log,
            imu_t_s=log.imu_t_s[imu],
            imu=np.ascontiguousarray(log.imu[imu]),
            tacho_t_s=log.tacho_t_s[tacho],
            pulses=log.pulses[tacho],
        ),
        MotionTruth(truth.t_s[true], truth.distance_m[true], truth.speed_mps[true], truth.slip[true]),
    )


def full_run(case: Case) -> Case:
    """Switched on in full run."""
    fast = case.truth.speed_mps > FULL_SHARE * case.truth.speed_mps.max()
    return _cut(case, float(case.truth.t_s[np.flatnonzero(fast)[0]]))


def no_rest(case: Case) -> Case:
    """The longest stretch between two stops, without either."""
    moving = np.flatnonzero(case.truth.speed_mps > RUNNING_MPS)
    breaks = np.flatnonzero(np.diff(moving) > 1)
    firsts, lasts = np.r_[moving[0], moving[breaks + 1]], np.r_[moving[breaks], moving[-1]]
    longest = int(np.argmax(lasts - firsts))
    return _cut(case, float(case.truth.t_s[firsts[longest]]), float(case.truth.t_s[lasts[longest]]))


def in_slip(case: Case) -> Case:
    """Switched on in the third slip."""
    begins = np.flatnonzero((case.truth.slip[1:] != 0) & (case.truth.slip[:-1] == 0))
    return _cut(case, float(case.truth.t_s[begins[min(2, len(begins) - 1)]]) + INTO_SLIP_S)


def pulse_by_pulse(teeth: int) -> Callable[[Case], Case]:
    """A counter that reports every so-manieth pulse when it comes, and nothing in between."""

    def spoil(case: Case) -> Case:
        log = case.log
        ahead = np.maximum.accumulate(log.pulses)
        value, first = np.unique(ahead, return_index=True)
        last = np.r_[first[1:] - 1, len(ahead) - 1]
        # A count is reached when the wheel moves on, not while it rests at it.
        places = np.column_stack([value, value + 1e-6]).ravel()
        times_s = np.column_stack([log.tacho_t_s[first], log.tacho_t_s[last]]).ravel()
        counts = np.arange(ahead[0], ahead[-1] + 1, teeth)
        t_s = np.interp(counts, places, times_s)
        kept = np.r_[True, np.diff(t_s) > 0.0]
        fewer = log.pulses_per_revolution / teeth
        pulses = (counts[kept] - ahead[0]) // teeth
        return Case(replace(log, tacho_t_s=t_s[kept], pulses=pulses, pulses_per_revolution=fewer), case.truth)

    return spoil


def rows_of_four(case: Case) -> Case:
    """A counter that reports every fourth pulse when it comes, counting all of them."""
    spoilt = pulse_by_pulse(4)(case)
    log = spoilt.log
    return Case(replace(log, pulses=4 * log.pulses, pulses_per_revolution=case.log.pulses_per_revolution), spoilt.truth)


def halved(case: Case) -> Case:
    """Inertial samples at half the rate, means of two."""
    log, pairs = case.log, len(case.log.imu_t_s) // 2
    imu = log.imu[: 2 * pairs].reshape(pairs, 2, 6).mean(axis=1)
    return Case(replace(log, imu_t_s=log.imu_t_s[1 : 2 * pairs : 2], imu=imu), case.truth)


VARIANTS: dict[str, Callable[[Case], Case]] = {
    "as it is": lambda case: case,
    "stamps jitter by 8 ms": jitter(0.008),
    "stamps late by up to 8 ms (1 σ)": jitter(0.008, late=True),
    "stamps jitter by 15 ms": jitter(0.015),
    "stamps jitter by 30 ms": jitter(0.030),
    "latency stated 0.1 s too long": latency(0.1),
    "latency stated 0.1 s too short": latency(-0.1),
    "begins in full run": full_run,
    "no standstill at all": no_rest,
    "begins in a slip": in_slip,
    "wheel stated 2 % too large": wheel(1.02),
    "wheel stated 2 % too small": wheel(0.98),
    "a row per pulse": pulse_by_pulse(1),
    "a row per pulse, 8 times fewer teeth": pulse_by_pulse(8),
    "a row per four pulses": rows_of_four,
    "inertial samples at 50 Hz": halved,
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path, metavar="LOG", help="motion logs; without any, simulated ones")
    parser.add_argument("--slips", type=int, default=150, help="of simulated logs")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--gradient", type=float, default=16.0, help="per mille, of simulated lines")
    parser.add_argument("--method", choices=("wheel", "paper", "fused"), default="paper")
    parser.add_argument(
        "--only",
        action="append",
        metavar="VARIANT",
        choices=list(VARIANTS),
        help="; ".join(VARIANTS).replace("%", "%%"),
    )
    asked = parser.parse_args()
    try:
        cases = [given(folder) for folder in asked.logs] or simulated(asked.slips, asked.seed, asked.gradient)
    except (MotionLogError, OSError) as error:
        parser.error(str(error))
    sys.stdout.write(HEADER + "\n")
    config = Config(method=asked.method)
    for name in asked.only or VARIANTS:
        figures = Figures()
        for case in cases:
            judge(VARIANTS[name](case), config, figures)
        sys.stdout.write(figures.line(name) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
