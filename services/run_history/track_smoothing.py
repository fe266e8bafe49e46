"""Speed, way and acceleration of a run from fixes at about 1 Hz: a smoother, or the article's average.

The smoother (Rauch, Tung, Striebel 1965) has the state way, speed, acceleration, driven by jerk; fixes that
disagree with their neighbours lose weight (Student's t, three passes). Its own covariance says how sure speed
and acceleration are, which the energy needs: noise in the speed, squared by a plain average, would be taken
for traction. Errors of neighbouring positions are alike; they count for little beside the Doppler speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import inner_kernel, kernel

Floats = NDArray[np.float64]

JERK: Final = 0.0003
"""Spectral density of the jerk [m²/s⁵]: trains change their acceleration by about 0.2 m/s² within a second."""
SPEED_SIGMA_MPS: Final = 0.15
PLACE_SIGMA_M: Final = 20.0
"""Of a single fix, its likeness with its neighbours included."""
LONE_PLACE_SIGMA_M: Final = 4.0
"""The same where there is no speed: then places are all there is."""
FREEDOM: Final = 1.0
PASSES: Final = 6


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
    has_speed = bool(np.isfinite(speed_mps).sum() > 0.2 * len(t_s))
    out = np.empty((len(t_s), 6))
    _smooth(t_s, way_m, speed_mps, PLACE_SIGMA_M if has_speed else LONE_PLACE_SIGMA_M, out)
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
def _smooth(t_s: Floats, way_m: Floats, speed_mps: Floats, place_sigma_m: float, out: Floats) -> None:
    """Fill `out` (n, 6): way, speed, acceleration, and their standard deviations."""
    n = t_s.size
    x, xp = np.empty((n, 3)), np.empty((n, 3))
    p, pp = np.empty((n, 3, 3)), np.empty((n, 3, 3))
    weight = np.ones((n, 2))
    scratch = np.empty((3, 3, 3))
    for _ in range(PASSES):
        _filter(t_s, way_m, speed_mps, place_sigma_m, weight, x, p, xp, pp)
        for i in range(n - 2, -1, -1):
            _back(t_s[i + 1] - t_s[i], x[i], p[i], x[i + 1] - xp[i + 1], p[i + 1] - pp[i + 1], pp[i + 1], scratch)
        for i in range(n):
            if np.isfinite(way_m[i]):
                weight[i, 0] = _weight((way_m[i] - x[i, 0]) / place_sigma_m)
            if np.isfinite(speed_mps[i]):
                weight[i, 1] = _weight((speed_mps[i] - x[i, 1]) / SPEED_SIGMA_MPS)
    for i in range(n):
        for k in range(3):
            out[i, k] = x[i, k]
            out[i, 3 + k] = np.sqrt(max(p[i, k, k], 0.0))


@inner_kernel
def _back(dt: float, x: Floats, p: Floats, ahead: Floats, spread: Floats, predicted: Floats, scratch: Floats) -> None:
    """One step backwards: `ahead` and `spread` are what later fixes changed at the next one."""
    a, b, gain = scratch[0], scratch[1], scratch[2]
    half = 0.5 * dt * dt
    for k in range(3):
        a[k, 0] = p[k, 0] + dt * p[k, 1] + half * p[k, 2]
        a[k, 1] = p[k, 1] + dt * p[k, 2]
        a[k, 2] = p[k, 2]
    _inverse(predicted, b)
    _product(a, b, gain)
    _product(gain, spread, a)
    for k in range(3):
        x[k] += gain[k, 0] * ahead[0] + gain[k, 1] * ahead[1] + gain[k, 2] * ahead[2]
        for m in range(3):
            p[k, m] += a[k, 0] * gain[m, 0] + a[k, 1] * gain[m, 1] + a[k, 2] * gain[m, 2]


@inner_kernel
def _product(left: Floats, right: Floats, out: Floats) -> None:
    for k in range(3):
        for m in range(3):
            out[k, m] = left[k, 0] * right[0, m] + left[k, 1] * right[1, m] + left[k, 2] * right[2, m]


@inner_kernel
def _filter(
    t_s: Floats,
    way_m: Floats,
    speed_mps: Floats,
    place_sigma_m: float,
    weight: Floats,
    x: Floats,
    p: Floats,
    xp: Floats,
    pp: Floats,
) -> None:
    """Forward pass: states and covariances after each fix (x, p) and before it (xp, pp)."""
    start = 0.0
    for i in range(t_s.size):
        if np.isfinite(way_m[i]):
            start = way_m[i]
            break
    for i in range(t_s.size):
        if i == 0:
            x[0, 0], x[0, 1], x[0, 2] = start, 0.0, 0.0
            if np.isfinite(speed_mps[0]):
                x[0, 1] = speed_mps[0]
            p[0] = 0.0
            p[0, 0, 0], p[0, 1, 1], p[0, 2, 2] = 1e4, 100.0, 0.25
        else:
            dt = t_s[i] - t_s[i - 1]
            x[i, 0] = x[i - 1, 0] + dt * x[i - 1, 1] + 0.5 * dt * dt * x[i - 1, 2]
            x[i, 1] = x[i - 1, 1] + dt * x[i - 1, 2]
            x[i, 2] = x[i - 1, 2]
            _predict(p[i - 1], dt, p[i])
        xp[i] = x[i]
        pp[i] = p[i]
        if np.isfinite(way_m[i]):
            _take(x[i], p[i], 0, way_m[i], place_sigma_m * place_sigma_m / weight[i, 0])
        if np.isfinite(speed_mps[i]):
            _take(x[i], p[i], 1, speed_mps[i], SPEED_SIGMA_MPS * SPEED_SIGMA_MPS / weight[i, 1])


@inner_kernel
def _predict(before: Floats, dt: float, after: Floats) -> None:
    """F P Fᵀ + Q of jerk over `dt`."""
    half = 0.5 * dt * dt
    for m in range(3):
        after[0, m] = before[0, m] + dt * before[1, m] + half * before[2, m]
        after[1, m] = before[1, m] + dt * before[2, m]
        after[2, m] = before[2, m]
    for k in range(3):
        first, second, third = after[k, 0], after[k, 1], after[k, 2]
        after[k, 0] = first + dt * second + half * third
        after[k, 1] = second + dt * third
    after[0, 0] += JERK * dt**5 / 20.0
    after[0, 1] += JERK * dt**4 / 8.0
    after[0, 2] += JERK * dt**3 / 6.0
    after[1, 0] += JERK * dt**4 / 8.0
    after[1, 1] += JERK * dt**3 / 3.0
    after[1, 2] += JERK * dt * dt / 2.0
    after[2, 0] += JERK * dt**3 / 6.0
    after[2, 1] += JERK * dt * dt / 2.0
    after[2, 2] += JERK * dt


@inner_kernel
def _take(state: Floats, cov: Floats, what: int, value: float, variance: float) -> None:
    """Take a measurement of one component in."""
    innovation = value - state[what]
    s = cov[what, what] + variance
    r0, r1, r2 = cov[what, 0], cov[what, 1], cov[what, 2]
    for k in range(3):
        gain = cov[k, what] / s
        state[k] += gain * innovation
        cov[k, 0] -= gain * r0
        cov[k, 1] -= gain * r1
        cov[k, 2] -= gain * r2


@inner_kernel
def _inverse(m: Floats, out: Floats) -> None:
    """Inverse of a symmetric matrix of three rows, by cofactors."""
    c00 = m[1, 1] * m[2, 2] - m[1, 2] * m[1, 2]
    c01 = m[0, 2] * m[1, 2] - m[0, 1] * m[2, 2]
    c02 = m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]
    scale = 1.0 / (m[0, 0] * c00 + m[0, 1] * c01 + m[0, 2] * c02)
    out[0, 0] = c00 * scale
    out[0, 1] = out[1, 0] = c01 * scale
    out[0, 2] = out[2, 0] = c02 * scale
    out[1, 1] = (m[0, 0] * m[2, 2] - m[0, 2] * m[0, 2]) * scale
    out[1, 2] = out[2, 1] = (m[0, 1] * m[0, 2] - m[0, 0] * m[1, 2]) * scale
    out[2, 2] = (m[0, 0] * m[1, 1] - m[0, 1] * m[0, 1]) * scale


@inner_kernel
def _weight(residual: float) -> float:
    return (FREEDOM + 1.0) / (FREEDOM + residual * residual)
