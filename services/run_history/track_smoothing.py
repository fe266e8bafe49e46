"""Speed, way and acceleration of a run from fixes at about 1 Hz: a smoother, or the article's average.

The smoother has the state way, speed, acceleration, driven by jerk, and two errors of the receiver that wander as
Gauss-Markov processes: of its speed (a chip filters its Doppler) and of its place (multipath and the sky change
slowly). A speed that wanders for half a minute is contradicted by places whose error stays the same meanwhile; with
white errors alone it would be taken for traction. Fixes that disagree with their neighbours lose weight (Student's t);
places begin with little weight, so that none of them draws the first pass to itself. Backwards it goes in the form of
Bryson and Frazier (1963), which needs no inverse. Its own covariance says how sure speed and acceleration are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import inner_kernel, kernel
from services.run_history.speed_credibility import ZERO_MPS

Floats = NDArray[np.float64]

JERK: Final = 0.0005
"""Spectral density of the jerk [m²/s⁵]."""
SPEED_SIGMA_MPS: Final = 0.15
"""Of the white part of a speed's error."""
WANDER_MPS: Final = 0.3
"""Of the wandering part: phones had 0.2 to 0.37 m/s, alike for 5 to 10 s, against a better receiver on one train."""
WANDER_S: Final = 7.5
PLACE_SIGMA_M: Final = 1.0
"""Of the white part of a place's error …"""
FIRST_PLACE_SIGMA_M: Final = 32.0
"""… which begins with this and is halved in each pass."""
PLACE_WANDER_M: Final = 4.0
"""Of the wandering part: 0.75 m in 2 s, 2 m in 10 s, 4 m in 40 s, no more than 6 m in 160 s."""
PLACE_WANDER_S: Final = 70.0
FREEDOM: Final = 1.0
PASSES: Final = 6
RESTART_S: Final = 300.0
"""After a gap as long nothing of before is left."""
WAY, SPEED, ACCELERATION, SPEED_ERROR, PLACE_ERROR, NONE = 0, 1, 2, 3, 4, -1
STATES: Final = 5
FIRST_VARIANCES: Final = (1e4, 100.0, 0.25, WANDER_MPS**2, PLACE_WANDER_M**2)


@dataclass(frozen=True, slots=True)
class Smoothed:
    """A run at its own times. All arrays have shape (n,)."""

    t_s: Floats
    way_m: Floats
    speed_mps: Floats
    acceleration_mps2: Floats
    way_sigma_m: Floats
    speed_sigma_mps: Floats
    acceleration_sigma_mps2: Floats


def smoothed(t_s: Floats, way_m: Floats, speed_mps: Floats) -> Smoothed:
    """Smooth a run; NaN in `way_m` or `speed_mps` is what was not measured. Times rise. Shapes (n,)."""
    out = np.empty((len(t_s), 6))
    _smooth(t_s, way_m, speed_mps, out)
    return Smoothed(t_s, *(out[:, k].copy() for k in range(6)))


def moving_average(t_s: Floats, speed_mps: Floats, window_s: float) -> Floats:
    """Mean of what was measured within half a window to both sides (Maki et al., 3.2); NaN where nothing was."""
    known = np.isfinite(speed_mps)
    total = np.concatenate(([0.0], np.cumsum(np.where(known, speed_mps, 0.0))))
    count = np.concatenate(([0], np.cumsum(known)))
    # A hair more than half, so that fixes exactly at the edge count on both sides.
    first = np.searchsorted(t_s, t_s - window_s / 2.0 - 1e-6)
    past = np.searchsorted(t_s, t_s + window_s / 2.0 + 1e-6)
    n = count[past] - count[first]
    return np.where(n > 0, (total[past] - total[first]) / np.maximum(n, 1), np.nan)


@kernel
def _smooth(t_s: Floats, way_m: Floats, speed_mps: Floats, out: Floats) -> None:
    """Fill `out` (n, 6): way, speed, acceleration, and their standard deviations."""
    n = t_s.size
    x, p = np.empty((n, STATES)), np.empty((n, STATES, STATES))
    taken = np.empty((n, 2, STATES + 2))
    weight = np.ones((n, 2))
    kept = np.zeros((n, 2))
    for i in range(1, n):
        dt = t_s[i] - t_s[i - 1]
        kept[i, 0], kept[i, 1] = np.exp(-dt / WANDER_S), np.exp(-dt / PLACE_WANDER_S)
    place_sigma_m = FIRST_PLACE_SIGMA_M
    for number in range(PASSES):
        _forward(t_s, way_m, speed_mps, kept, place_sigma_m, weight, x, p, taken)
        _backward(t_s, speed_mps, kept, p, taken, x, out, number == PASSES - 1)
        place_sigma_m = max(PLACE_SIGMA_M, 0.5 * place_sigma_m)
        for i in range(n):
            if np.isfinite(way_m[i]):
                weight[i, 0] = _weight((way_m[i] - x[i, WAY] - x[i, PLACE_ERROR]) / place_sigma_m)
            if np.isfinite(speed_mps[i]):
                error = _speed_error(speed_mps[i])
                wanders = x[i, error] if error != NONE else 0.0
                weight[i, 1] = _weight((speed_mps[i] - x[i, SPEED] - wanders) / SPEED_SIGMA_MPS)
    for i in range(n):
        for k in range(3):
            out[i, k] = x[i, k]


@inner_kernel
def _forward(
    t_s: Floats,
    way_m: Floats,
    speed_mps: Floats,
    kept: Floats,
    place_sigma_m: float,
    weight: Floats,
    x: Floats,
    p: Floats,
    taken: Floats,
) -> None:
    """States (x) and covariances (p) before each fix, and what its measurements did: gain, 1/variance, innovation.

    `kept` (n, 2): what is left of both errors since the fix before. `taken` (n, 2, 7): place and speed of a fix;
    1/variance is 0 where there was none.
    """
    state, cov, row = np.zeros(STATES), np.zeros((STATES, STATES)), np.empty(STATES)
    for i in range(t_s.size):
        dt = t_s[i] - t_s[i - 1] if i > 0 else RESTART_S
        if dt >= RESTART_S:
            _start(way_m, speed_mps, i, state, cov)
        else:
            _predict(dt, kept[i, 0], kept[i, 1], state, cov)
        x[i] = state
        p[i] = cov
        taken[i] = 0.0
        if np.isfinite(way_m[i]):
            variance = place_sigma_m * place_sigma_m / weight[i, 0]
            _take(state, cov, WAY, PLACE_ERROR, way_m[i], variance, taken[i, 0], row)
        if np.isfinite(speed_mps[i]):
            variance = SPEED_SIGMA_MPS * SPEED_SIGMA_MPS / weight[i, 1]
            _take(state, cov, SPEED, _speed_error(speed_mps[i]), speed_mps[i], variance, taken[i, 1], row)


@inner_kernel
def _speed_error(speed_mps: float) -> int:
    """Which error a speed carries: receivers hold zero while a train stands, and there it does not wander."""
    return NONE if abs(speed_mps) <= ZERO_MPS else SPEED_ERROR


@inner_kernel
def _start(way_m: Floats, speed_mps: Floats, first: int, state: Floats, cov: Floats) -> None:
    """State and covariance from nothing but the first place and the first speed."""
    state[:] = 0.0
    cov[:] = 0.0
    for i in range(first, way_m.size):
        if np.isfinite(way_m[i]):
            state[WAY] = way_m[i]
            break
    if np.isfinite(speed_mps[first]):
        state[SPEED] = speed_mps[first]
    for k in range(STATES):
        cov[k, k] = FIRST_VARIANCES[k]


@inner_kernel
def _predict(dt: float, keep: float, keep_place: float, state: Floats, cov: Floats) -> None:
    """F x and F P Fᵀ + Q over `dt`: jerk, and what the errors keep and gain anew."""
    half = 0.5 * dt * dt
    state[WAY] += dt * state[SPEED] + half * state[ACCELERATION]
    state[SPEED] += dt * state[ACCELERATION]
    state[SPEED_ERROR] *= keep
    state[PLACE_ERROR] *= keep_place
    for m in range(STATES):
        cov[0, m] += dt * cov[1, m] + half * cov[2, m]
        cov[1, m] += dt * cov[2, m]
        cov[3, m] *= keep
        cov[4, m] *= keep_place
    for m in range(STATES):
        cov[m, 0] += dt * cov[m, 1] + half * cov[m, 2]
        cov[m, 1] += dt * cov[m, 2]
        cov[m, 3] *= keep
        cov[m, 4] *= keep_place
    way_speed, way_acceleration, speed_acceleration = JERK * dt**4 / 8.0, JERK * dt**3 / 6.0, JERK * half
    cov[0, 0] += JERK * dt**5 / 20.0
    cov[0, 1] += way_speed
    cov[1, 0] += way_speed
    cov[0, 2] += way_acceleration
    cov[2, 0] += way_acceleration
    cov[1, 1] += JERK * dt**3 / 3.0
    cov[1, 2] += speed_acceleration
    cov[2, 1] += speed_acceleration
    cov[2, 2] += JERK * dt
    cov[3, 3] += WANDER_MPS * WANDER_MPS * (1.0 - keep * keep)
    cov[4, 4] += PLACE_WANDER_M * PLACE_WANDER_M * (1.0 - keep_place * keep_place)


@inner_kernel
def _take(
    state: Floats, cov: Floats, what: int, error: int, value: float, variance: float, taken: Floats, row: Floats
) -> None:
    """Take a measurement of a component and its error (NONE: without) in, and note what it did in `taken`."""
    innovation = value - state[what]
    for m in range(STATES):
        row[m] = cov[what, m]
    if error != NONE:
        innovation -= state[error]
        for m in range(STATES):
            row[m] += cov[error, m]
    spread = row[what] + variance + (row[error] if error != NONE else 0.0)
    for m in range(STATES):
        gain = row[m] / spread
        taken[m] = gain
        state[m] += gain * innovation
        for k in range(STATES):
            cov[m, k] -= gain * row[k]
    taken[STATES] = 1.0 / spread
    taken[STATES + 1] = innovation


@inner_kernel
def _backward(
    t_s: Floats,
    speed_mps: Floats,
    kept: Floats,
    p: Floats,
    taken: Floats,
    x: Floats,
    out: Floats,
    last: bool,  # noqa: FBT001 - kernels take no keywords
) -> None:
    """Turn predicted states into smoothed ones; in the last pass also their standard deviations into `out`.

    What later fixes say of a state is x − P λ, with covariance P − P Λ P; λ and Λ are carried backwards.
    """
    later, spread, column = np.zeros(STATES), np.zeros((STATES, STATES)), np.empty(STATES)
    for i in range(t_s.size - 1, -1, -1):
        if taken[i, 1, STATES] != 0.0:
            _give_back(taken[i, 1], SPEED, _speed_error(speed_mps[i]), later, spread, column, last)
        if taken[i, 0, STATES] != 0.0:
            _give_back(taken[i, 0], WAY, PLACE_ERROR, later, spread, column, last)
        for m in range(STATES):
            for k in range(STATES):
                x[i, m] -= p[i, m, k] * later[k]
        if last:
            for m in range(3):
                out[i, 3 + m] = np.sqrt(max(p[i, m, m] - _square(p[i, m], spread), 0.0))
        dt = t_s[i] - t_s[i - 1] if i > 0 else RESTART_S
        if dt >= RESTART_S:
            later[:] = 0.0
            spread[:] = 0.0
        else:
            _step_back(dt, kept[i, 0], kept[i, 1], later, spread, last)


@inner_kernel
def _square(row: Floats, matrix: Floats) -> float:
    total = 0.0
    for m in range(STATES):
        for k in range(STATES):
            total += row[m] * matrix[m, k] * row[k]
    return total


@inner_kernel
def _give_back(
    taken: Floats,
    what: int,
    error: int,
    later: Floats,
    spread: Floats,
    column: Floats,
    last: bool,  # noqa: FBT001 - kernels take no keywords
) -> None:
    """λ and Λ before a measurement from those after it: (I − K h)ᵀ λ − hᵀ y / S, and the like for Λ."""
    told = taken[STATES] * taken[STATES + 1]
    for m in range(STATES):
        told += taken[m] * later[m]
    later[what] -= told
    if error != NONE:
        later[error] -= told
    if not last:
        return
    square = taken[STATES]
    for m in range(STATES):
        column[m] = 0.0
        for k in range(STATES):
            column[m] += spread[m, k] * taken[k]
        square += taken[m] * column[m]
    for m in range(STATES):
        spread[what, m] -= column[m]
        spread[m, what] -= column[m]
        if error != NONE:
            spread[error, m] -= column[m]
            spread[m, error] -= column[m]
    spread[what, what] += square
    if error != NONE:
        spread[error, error] += square
        spread[what, error] += square
        spread[error, what] += square


@inner_kernel
def _step_back(
    dt: float,
    keep: float,
    keep_place: float,
    later: Floats,
    spread: Floats,
    last: bool,  # noqa: FBT001 - kernels take no keywords
) -> None:
    """Fᵀ λ and Fᵀ Λ F over `dt`."""
    half = 0.5 * dt * dt
    later[2] += half * later[0] + dt * later[1]
    later[1] += dt * later[0]
    later[3] *= keep
    later[4] *= keep_place
    if not last:
        return
    for m in range(STATES):
        spread[2, m] += half * spread[0, m] + dt * spread[1, m]
        spread[1, m] += dt * spread[0, m]
        spread[3, m] *= keep
        spread[4, m] *= keep_place
    for m in range(STATES):
        spread[m, 2] += half * spread[m, 0] + dt * spread[m, 1]
        spread[m, 1] += dt * spread[m, 0]
        spread[m, 3] *= keep
        spread[m, 4] *= keep_place


@inner_kernel
def _weight(residual: float) -> float:
    return (FREEDOM + 1.0) / (FREEDOM + residual * residual)
