"""What ordinary runs tell of the sensors: latency, mounting angles, wheel diameter, detection threshold.

Iwata et al. (section 4) measured the delay between pulse counter and inertial sensor while accelerating and
braking, and set the threshold Ta from the differences seen in running. The same is done here over whole
logs; every figure comes with the spread over stretches of the log.

Motion by the wheel is a symmetric mean over WINDOW_S, which delays nothing. Logs are taken as they are:
stretches in which
the sensors contradict each other far more than usual (slips) are left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.motion_sensors.imu_sample import STANDARD_GRAVITY_MPS2
from services.odometry_fusion.motion_log import MotionLog

Floats = NDArray[np.float64]

STEP_S: Final = 0.05
WINDOW_S: Final = 1.0
LEVEL_S: Final = 20.0
"""Differences that last longer than this are gradient and bias, not delay."""
STRETCH_S: Final = 120.0
_LATENCIES_S: Final = np.arange(-0.5, 2.0001, STEP_S)
_WORTH_MPS2: Final = 0.05
"""Spread of acceleration without which a stretch tells no delay."""
_STRAIGHT_RADPS: Final = 0.004
_REST_S: Final = 3.0
_STILL_M: Final = 0.004
"""A wheel that turns by less over _REST_S stands: counters made of a measured speed creep."""
_KMHPS: Final = 3.6
_MEAN_S: Final = 3.0
"""Moving average before the threshold is compared (Iwata et al., section 4.1)."""
_OUTLYING: Final = 4.0
"""Standard deviations (by the median deviation) beyond which a difference between the sensors is a slip's."""
_AROUND_S: Final = 4.0
"""Before and after such a difference the wheel is not to be trusted either."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A figure, its standard error over the stretches it came from, and how many these were."""

    value: float
    error: float
    stretches: int

    @property
    def known(self) -> bool:
        """Whether there was anything to go by."""
        return self.stretches > 0


@dataclass(frozen=True, slots=True)
class Calibration:
    """What runs tell together."""

    latency_s: Estimate
    roll_deg: Estimate
    pitch_deg: Estimate
    yaw_deg: Estimate
    wheel_diameter_m: Estimate
    threshold_kmhps: Estimate
    """Ta of equation (1)."""


@dataclass(frozen=True, slots=True)
class _Grid:
    """A log on even times: speed and acceleration by the wheel, six axes by the sensor."""

    t_s: Floats
    speed_mps: Floats
    wheel_mps2: Floats
    imu: NDArray[np.float64]
    resting: NDArray[np.bool_]


def calibrate(logs: list[MotionLog], known_m: list[float] | None = None) -> Calibration:
    """Calibration from runs; `known_m` gives the true distance of each, where it is known.

    Raises ValueError when a log is too short for anything.
    """
    if any(log.end_s - min(log.imu_t_s[0], log.tacho_t_s[0]) < 2.0 * LEVEL_S for log in logs):
        msg = f"a log is shorter than {2.0 * LEVEL_S:.0f} s: take a run from one stop to another, at least"
        raise ValueError(msg)
    # Sensors far out of step contradict each other everywhere; a first look brings them together.
    roughs = [_estimate(_latencies(grid, np.ones(len(grid.t_s), bool))) for grid in (_grid(log, 0.0) for log in logs)]
    starts = [rough.value if rough.known else 0.0 for rough in roughs]
    shifted = [(start, _grid(log, start)) for log, start in zip(logs, starts, strict=True)]
    latency = _estimate([start + one for start, grid in shifted for one in _latencies(grid, ~_contradicted(grid))])
    shift_s = latency.value if latency.known else float(np.median([log.imu_latency_s for log in logs]))
    grids = [_grid(log, shift_s) for log in logs]
    rolls, pitches = _levels(grids)
    diameters = (
        [
            known / (math.pi * abs(int(log.pulses[-1] - log.pulses[0])) / log.pulses_per_revolution)
            for log, known in zip(logs, known_m or [], strict=True)
        ]
        if known_m
        else []
    )
    return Calibration(
        latency_s=latency,
        roll_deg=_estimate(rolls),
        pitch_deg=_estimate(pitches),
        yaw_deg=_estimate([one for grid in grids for one in _yaws(grid)]),
        wheel_diameter_m=_estimate(diameters),
        threshold_kmhps=_estimate([one for grid in grids for one in _thresholds(grid)]),
    )


def _estimate(values: list[float]) -> Estimate:
    """Median, and its standard error by the spread (1.2533 σ/√n, σ by the median deviation)."""
    if not values:
        return Estimate(math.nan, math.inf, 0)
    middle = float(np.median(values))
    spread = 1.4826 * float(np.median(np.abs(np.array(values) - middle)))
    return Estimate(middle, 1.2533 * spread / math.sqrt(len(values)), len(values))


def _grid(log: MotionLog, latency_s: float) -> _Grid:
    """The log on even times where both sensors have samples, the inertial ones moved back by the latency."""
    start = max(log.imu_t_s[0] - latency_s, log.tacho_t_s[0]) + WINDOW_S
    end = min(log.imu_t_s[-1] - latency_s, log.tacho_t_s[-1]) - WINDOW_S
    t_s = np.arange(start, end, STEP_S)
    metre = math.pi * log.wheel_diameter_m / log.pulses_per_revolution
    way = log.pulses * metre
    edge = np.array([-0.5, 0.5]) * WINDOW_S
    before, after = (np.interp(t_s + one, log.tacho_t_s, way) for one in edge)
    speed = (after - before) / WINDOW_S
    wheel = np.gradient(speed, STEP_S)
    sums = np.concatenate([np.zeros((1, 6)), np.cumsum(log.imu, axis=0)])
    first, last = (np.searchsorted(log.imu_t_s - latency_s, t_s + one) for one in edge)
    imu = (sums[last] - sums[first]) / np.maximum(last - first, 1)[:, None]
    rested_m = np.interp(t_s + 0.5 * _REST_S, log.tacho_t_s, way) - np.interp(t_s - 0.5 * _REST_S, log.tacho_t_s, way)
    still = np.abs(rested_m) < _STILL_M
    return _Grid(t_s, speed, _mean(wheel, WINDOW_S), _mean(imu, WINDOW_S), still)


def _mean(values: NDArray[np.float64], window_s: float) -> NDArray[np.float64]:
    """Symmetric moving average; at the ends over what there is."""
    count = max(round(window_s / STEP_S), 1) | 1
    kernel = np.ones(count)
    columns = values[:, None] if values.ndim == 1 else values
    weight = np.convolve(np.ones(len(columns)), kernel, "same")
    averaged = np.stack([np.convolve(one, kernel, "same") / weight for one in columns.T], axis=1)
    return averaged[:, 0] if values.ndim == 1 else averaged


def _stretches(grid: _Grid) -> list[slice]:
    size = round(STRETCH_S / STEP_S)
    return [slice(a, min(a + size, len(grid.t_s))) for a in range(0, max(len(grid.t_s) - size // 2, 1), size)]


def _latencies(grid: _Grid, trusted: NDArray[np.bool_]) -> list[float]:
    """Delay of the sensor behind the wheel in every stretch that accelerates or brakes enough."""
    wheel = grid.wheel_mps2 - _mean(grid.wheel_mps2, LEVEL_S)
    force = grid.imu[:, 0] - _mean(grid.imu[:, 0], LEVEL_S)
    steps = np.round(_LATENCIES_S / STEP_S).astype(int)
    found = []
    for part in _stretches(grid):
        inner = np.arange(max(part.start, -steps[0]), min(part.stop, len(wheel) - steps[-1]))
        inner = inner[trusted[inner]]
        if len(inner) < STRETCH_S / STEP_S / 4 or float(np.std(wheel[inner])) < _WORTH_MPS2:
            continue
        likeness = np.array([_correlation(wheel[inner], force[inner + step]) for step in steps])
        best = int(np.argmax(likeness))
        if 0 < best < len(steps) - 1:
            left, top, right = likeness[best - 1 : best + 2]
            found.append(float(_LATENCIES_S[best] + 0.5 * STEP_S * (left - right) / (left - 2.0 * top + right)))
    return found


def _correlation(first: Floats, second: Floats) -> float:
    spread = float(np.std(first) * np.std(second))
    return float(np.mean((first - first.mean()) * (second - second.mean()))) / spread if spread > 0.0 else 0.0


def _levels(grids: list[_Grid]) -> tuple[list[float], list[float]]:
    """Roll and pitch of the sensor [deg] at every standstill; cant and gradient there are in them.

    Of runs without any stop: over stretches, the motion by the wheel taken off; the way is level in the mean then.
    """
    forces = []
    for grid in grids:
        edges = np.flatnonzero(np.diff(np.r_[0, grid.resting.astype(np.int8), 0]))
        forces += [grid.imu[a:b, :3].mean(axis=0) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    if not forces:
        forces = [force for grid in grids for force in _forces_in_motion(grid)]
    rolls = [math.degrees(math.atan2(force[1], force[2])) for force in forces]
    pitches = [-math.degrees(math.asin(force[0] / max(float(np.linalg.norm(force)), 1e-9))) for force in forces]
    return rolls, pitches


def _forces_in_motion(grid: _Grid) -> list[Floats]:
    """Specific force of every stretch [m/s²], freed of what speeds the train up and of what a curve takes."""
    forces = []
    trusted = ~_contradicted(grid)
    for part in _stretches(grid):
        use = trusted[part]
        if use.sum() * STEP_S > LEVEL_S:
            taken = np.stack([grid.wheel_mps2, grid.speed_mps * grid.imu[:, 5], np.zeros(len(grid.t_s))], axis=1)
            forces.append(np.asarray((grid.imu[part, :3] - taken[part])[use].mean(axis=0)))
    return forces


def _yaws(grid: _Grid) -> list[float]:
    """Yaw of the sensor [deg] by how much of the acceleration appears across, on straights."""
    found = []
    trusted = ~_contradicted(grid)
    for part in _stretches(grid):
        use = (np.abs(grid.imu[part, 5]) < _STRAIGHT_RADPS) & ~grid.resting[part] & trusted[part]
        wheel, across = grid.wheel_mps2[part][use], grid.imu[part, 1][use]
        if use.sum() * STEP_S > LEVEL_S and float(np.std(wheel)) > 2.0 * _WORTH_MPS2:
            slope = float(np.cov(wheel, across)[0, 1] / np.var(wheel))
            found.append(-math.degrees(math.atan(slope)))
    return found


def _differences(grid: _Grid) -> Floats:
    """Acceleration by the sensor less that by the wheel [m/s²], as equation (1) compares them."""
    return _mean(grid.imu[:, 0], _MEAN_S) - _mean(grid.wheel_mps2, _MEAN_S)


def _usual_mps2(grid: _Grid) -> tuple[float, float]:
    """Middle of the differences while running, and how far they usually go from it."""
    difference = _differences(grid)[~grid.resting]
    if len(difference) == 0:
        return 0.0, math.inf
    middle = float(np.median(difference))
    return middle, _OUTLYING * 1.4826 * float(np.median(np.abs(difference - middle)))


def _contradicted(grid: _Grid) -> NDArray[np.bool_]:
    """Times near a difference far beyond the usual ones."""
    middle, most = _usual_mps2(grid)
    far = np.abs(_differences(grid) - middle) > most
    around = np.ones(round(2.0 * _AROUND_S / STEP_S) | 1)
    return np.convolve(far, around, "same")[: len(far)] > 0.0


def _thresholds(grid: _Grid) -> list[float]:
    """Ta [km/h/s] that a run asks for: the differences that are usual in it (gradients and noise)."""
    if grid.resting.all():
        return []
    middle, most = _usual_mps2(grid)
    return [(abs(middle) + most) * _KMHPS]


def gradient_threshold_kmhps(max_gradient_permille: float) -> float:
    """Ta that the steepest gradient alone asks for (Iwata et al.: 35 per mille give 1.23 km/h/s).

    >>> round(gradient_threshold_kmhps(35.0), 3)
    1.235
    """
    return STANDARD_GRAVITY_MPS2 * max_gradient_permille * 1e-3 * _KMHPS
