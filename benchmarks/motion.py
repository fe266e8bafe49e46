"""Odometry: an hour of motion log per method, a live step, beside filters as one would write them today.

The peers are written for this comparison alone: a plain error-state Kalman filter (speed, pitch, gyro bias) in numpy,
one step per inertial sample, and the same with its matrices inverted and multiplied as filterpy does. They detect no
slips. Rounds alternate between the sides and medians are compared. The log is made up (an hour at 100 Hz and 10 Hz).
"""

from __future__ import annotations

import json as json_text
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.bus import machine
from schemas.motion import OdometryMethod
from services.odometry_fusion.methods import begin, run_log
from services.odometry_fusion.motion_log import MotionLog
from services.odometry_fusion.settings import Config

ROUNDS = 5
HOUR_S = 3_600.0
STEP_S = 0.01
PEER_S = 120.0
"""The peers run so much of the log, and are reckoned up to an hour."""
LIVE_S = 300.0
METHODS: tuple[OdometryMethod, ...] = ("wheel", "paper", "fused")


@dataclass(frozen=True, slots=True)
class Result:
    """One measurement. `ratio` is the peer's time over ours; None where there is no peer."""

    case: str
    unit: str
    ours: float
    peer: str = ""
    theirs: float | None = None
    ratio: float | None = None


def made_log(duration_s: float = HOUR_S, seed: int = 1) -> MotionLog:
    """Runs of 150 s between stops, a slide of the wheel in each, noise as of a real sensor."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(0.0, duration_s, STEP_S)
    phase_s = t_s % 150.0
    speed_mps = np.interp(phase_s, [0, 20, 55, 100, 130, 150], [0, 0, 22, 22, 0, 0])
    forward_mps2 = np.gradient(speed_mps, STEP_S)
    slip_mps = np.interp(phase_s, [105, 108, 111, 113], [0, 4, 4, 0])
    way_m = np.cumsum(np.maximum(speed_mps - slip_mps, 0.0)) * STEP_S
    imu = rng.normal(0.0, 1.0, (len(t_s), 6)) * ([0.07] * 3 + [0.001] * 3)
    imu[:, 0] += forward_mps2
    imu[:, 2] += 9.80665
    imu = np.roll(imu, 30, axis=0)
    at = slice(9, None, 10)
    pulses = np.floor(way_m[at] * 90.0 / (np.pi * 0.816)).astype(np.int64)
    return MotionLog(t_s, imu, t_s[at], pulses, 90.0, 0.816, 0.3, 35.0)


def peer_filter(log: MotionLog, duration_s: float, *, textbook: bool) -> float:
    """Distance by a Kalman filter of speed, pitch and gyro bias, in numpy, one sample after the other."""
    samples = round(duration_s / STEP_S)
    wheel_mps = np.gradient(log.pulses * log.vehicle.metres_per_pulse, log.tacho_t_s)
    state, covariance = np.zeros(3), np.diag([1.0, 1e-3, 1e-6])
    noise = np.diag([3.6e-5, 2e-8, 8e-13])
    pick: NDArray[np.float64] = np.array([[1.0, 0.0, 0.0]])
    distance_m = 0.0
    for k in range(samples):
        ax_mps2, gy_radps = log.imu[k, 0], log.imu[k, 4]
        change = np.array([[1.0, -9.80665 * STEP_S, 0.0], [0.0, 1.0, -STEP_S], [0.0, 0.0, 1.0]])
        state = state + STEP_S * np.array([ax_mps2 - 9.80665 * np.sin(state[1]), -gy_radps - state[2], 0.0])
        covariance = change @ covariance @ change.T + noise
        if k % 10 == 9:  # noqa: PLR2004 - the wheel speaks at every tenth sample
            spread = pick @ covariance @ pick.T + 0.0144
            if textbook:
                gain = covariance @ pick.T @ np.linalg.inv(spread)
                state = state + gain @ (np.array([wheel_mps[k // 10]]) - pick @ state)
                rest = np.eye(3) - gain @ pick
                covariance = rest @ covariance @ rest.T + gain * 0.0144 @ gain.T
            else:
                gain_row = covariance[:, 0] / spread[0, 0]
                state = state + gain_row * (wheel_mps[k // 10] - state[0])
                covariance = covariance - np.outer(gain_row, covariance[0])
        distance_m += float(state[0]) * STEP_S
    return distance_m


def seconds(work: Callable[[], object]) -> float:
    """How long `work` takes [s]."""
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def live_ms(log: MotionLog, method: OdometryMethod) -> list[float]:
    """Processor times of live steps, each with the samples of one period [ms]: other processes do not count."""
    step = begin(log.vehicle, Config(method=method))
    took: list[float] = []
    for k in range(round(LIVE_S / 0.1)):
        imu, tacho = slice(10 * k, 10 * k + 10), slice(k, k + 1)
        until_s = float(log.tacho_t_s[k])
        started = time.thread_time()
        step.advance(until_s, log.imu_t_s[imu], log.imu[imu], log.tacho_t_s[tacho], log.pulses[tacho])
        took.append(1e3 * (time.thread_time() - started))
    return took


def measure(rounds: int) -> list[Result]:
    """Every comparison."""
    log = made_log()
    hour = HOUR_S / PEER_S
    results: list[Result] = []
    for method in METHODS:
        config = Config(method=method)
        run_log(made_log(60.0), config)
        ours: list[float] = []
        plain: list[float] = []
        textbook: list[float] = []
        for _ in range(rounds):
            ours.append(seconds(lambda config=config: run_log(log, config)))  # type: ignore[misc]  # bound at once
            plain.append(hour * seconds(lambda: peer_filter(log, PEER_S, textbook=False)))
            textbook.append(hour * seconds(lambda: peer_filter(log, PEER_S, textbook=True)))
        own_s = statistics.median(ours)
        for peer, theirs in (("numpy filter", plain), ("textbook filter", textbook)):
            peer_s = statistics.median(theirs)
            results.append(Result(f"an hour of log, {method}", "s", own_s, peer, peer_s, peer_s / own_s))
        live_ms(log, method)
        took = sorted(one for _ in range(rounds) for one in live_ms(log, method))
        results.append(Result(f"live step, p99, {method}", "ms", took[int(0.99 * len(took))]))
        results.append(Result(f"live step, median, {method}", "ms", took[len(took) // 2]))
    return results


def table(results: list[Result]) -> str:
    """The comparisons as text."""
    lines = [f"{'':32}{'Kirotei':>12}{'peer':>12}  ratio"]
    for one in results:
        theirs = "-" if one.theirs is None else f"{one.theirs:,.3f}"
        ratio = "" if one.ratio is None else f"x {one.ratio:.1f} ({one.peer})"
        lines.append(f"{one.case:32}{one.ours:12,.3f}{theirs:>12}  {ratio}  [{one.unit}]")
    return "\n".join(lines)


def run(*, json: bool = False, rounds: int = ROUNDS) -> list[Result]:
    """Measure, print the table (or JSON) and give the results."""
    about = machine()
    results = measure(rounds)
    if json:
        found = {"machine": about, "results": [asdict(one) for one in results]}
        sys.stdout.write(json_text.dumps(found, indent=2) + "\n")
    else:
        sys.stdout.write(f"{about}\nmedians of {rounds} rounds\n{table(results)}\n")
    return results
