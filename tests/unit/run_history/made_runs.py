"""A straight line with three stations, and runs on it whose times are known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from schemas.line import Line, Station
from services.line.alignment import alignment_of
from services.run_history.fixes import RunLog
from services.run_history.run_analysis import RunResult, analyse_run
from services.run_history.vehicle import Resistance, Vehicle

Floats = NDArray[np.float64]
LINE = Line(
    id="made",
    name="Made",
    axis=tuple((135.0, 35.0 + k * 0.001, 0.0) for k in range(101)),
    stations=(
        Station(id="a", name="A", axis_m=1000.0),
        Station(id="b", name="B", axis_m=4000.0),
        Station(id="c", name="C", axis_m=8000.0),
    ),
)
WAY = alignment_of(LINE)
TRAIN = Vehicle(name="made", mass_t=100.0, resistance=Resistance(a_n=2000.0, c_n_per_mps2=10.0), max_speed_mps=33.3)
ZERO_S = 1_700_000_000.0
STAND_S = 40.0
RISE_MPS2, FALL_MPS2, FULL_MPS = 0.7, 0.7, 20.0


def leg_speed(length_m: float, t_s: Floats) -> Floats:
    """Speed of a leg that starts at 0: up, along, down."""
    rise_s, fall_s = FULL_MPS / RISE_MPS2, FULL_MPS / FALL_MPS2
    whole_s = leg_time_s(length_m)
    return np.clip(np.minimum(t_s * RISE_MPS2, (whole_s - t_s) * FALL_MPS2), 0.0, FULL_MPS) * (
        (t_s > 0.0) & (t_s < rise_s + fall_s + whole_s)
    )


def leg_time_s(length_m: float) -> float:
    """Running time in closed form."""
    return length_m / FULL_MPS + 0.5 * FULL_MPS / RISE_MPS2 + 0.5 * FULL_MPS / FALL_MPS2


def made_run(*, up: bool = True, run_id: str = "r1", zero_s: float = ZERO_S, noise: float = 1.0) -> RunLog:
    """A to B to C (or back), 40 s at each; noise of 2 m and 0.1 m/s times `noise`."""
    lengths = (3000.0, 4000.0) if up else (4000.0, 3000.0)
    first_s = STAND_S
    second_s = first_s + leg_time_s(lengths[0]) + STAND_S
    t = np.arange(0.0, second_s + leg_time_s(lengths[1]) + STAND_S, 1.0)
    fine = np.arange(0.0, t[-1] + 0.005, 0.01)
    speed = leg_speed(lengths[0], fine - first_s) + leg_speed(lengths[1], fine - second_s)
    way = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 0.01)))
    place = 1000.0 + np.interp(t, fine, way) if up else 8000.0 - np.interp(t, fine, way)
    rng = np.random.default_rng(7)
    lat, lon, _ = WAY.position(place)
    return RunLog(
        run_id,
        zero_s + t,
        lat + noise * rng.normal(0.0, 2.0 / 111_000.0, len(t)),
        lon + noise * rng.normal(0.0, 2.0 / 91_000.0, len(t)),
        np.abs(np.interp(t, fine, speed) + noise * rng.normal(0.0, 0.1, len(t))),
    )


def joined(first: RunLog, second: RunLog) -> RunLog:
    """Two runs as one log."""
    return RunLog(
        first.run_id,
        np.concatenate((first.t_unix_s, second.t_unix_s)),
        np.concatenate((first.lat_deg, second.lat_deg)),
        np.concatenate((first.lon_deg, second.lon_deg)),
        np.concatenate((first.speed_mps, second.speed_mps)),
    )


def part(log: RunLog, chosen: NDArray[np.bool_]) -> RunLog:
    """Some of a log's fixes."""
    return RunLog(log.run_id, log.t_unix_s[chosen], log.lat_deg[chosen], log.lon_deg[chosen], log.speed_mps[chosen])


def with_speed(log: RunLog, speed_mps: Floats) -> RunLog:
    """The same fixes with other speeds."""
    return replace(log, speed_mps=speed_mps)


def result_of(log: RunLog) -> RunResult:
    """Analysed on the made line."""
    return analyse_run(log, [WAY], LINE.stations, TRAIN)


def wandering(n: int, sigma: float, alike_s: float, seed: int) -> Floats:
    """A first-order Gauss-Markov error, one value a second."""
    keep = float(np.exp(-1.0 / alike_s))
    drawn = sigma * np.random.default_rng(seed).standard_normal(n)
    drawn[1:] *= np.sqrt(1.0 - keep * keep)
    found = np.empty(n)
    last = 0.0
    for k, one in enumerate(drawn.tolist()):
        found[k] = last = keep * last + one
    return found
