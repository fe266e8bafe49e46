"""The horizontal error that the robust filter vouches for, epoch by epoch.

Reflections last for seconds to minutes, so that the covariance of the filter, which averages
them as noise, promises far too much. Hence the error of the state is followed for every satellite
on the assumption that its pseudoranges have *always* been late by one standard deviation
(inflated by the residual seen), with the weights they really had:

    s(k) = P(k) P0(k)⁻¹ F s(k-1) + P(k) h w sqrt(σ² + r²)

(P0 and P before and after the epoch, h partials, w weight): consider analysis, with a bias per
satellite (Schmidt 1966; Bar-Shalom et al. 2001, 8.2). Satellites are late independently of each
other, so their responses add up in squares:

    bound = k sqrt(λ(P) + (e f)² λ(Σ s sᵀ) + common²) + moved

λ largest eigenvalue of the horizontal part; e excess of the residuals over their model, never below
one (Student's t bounds it above), held for a while, because reflections of several satellites at
once shift place and residuals together; f four after a start, falling to one in some ten seconds,
because a first epoch has nothing to be compared with; common: ionosphere, troposphere, orbits, which all
satellites of a region share and residuals do not show; moved: see robust_doubt.py. k is the setting
`bound_factor`. Its default and the constants below were chosen on the recordings that
docs/gnss_correction.md lists, where no error exceeds its bound: an engineering judgement, no
protection level in the sense of a certified integrity risk.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from services.gnss_correction.rejection import Rejection
from services.gnss_correction.robust_noise import FREEDOM
from services.gnss_correction.robust_state import CLOCK, SIZE, Memory
from services.gnss_correction.solver_arrays import Float64s, Records
from services.numerics.kernel import inner_kernel

COMMON_M: Final = 2.5
"""Horizontal error by broadcast orbits, Klobuchar's half of the ionosphere and the troposphere, one sigma."""
COMMON_WITHOUT_IONOSPHERE_M: Final = 5.0
"""The same where nothing was broadcast about the ionosphere."""
EXCESS_HELD_S: Final = 10.0
UNINFORMED: Final = 1.8
"""Least excess where no satellite has both Doppler and C/N0: without the one the velocity is guessed from reflected
pseudoranges, without the other nobody knows which are."""
SETTLING_S: Final = 12.0
UNSETTLED: Final = 3.0
"""A first epoch among buildings fits a wrong place as well as the right one: its bias counts four times."""
FORGOTTEN_M: Final = 1e-4
"""A response this small is dropped."""

_USABLE = int(Rejection.USABLE)


@inner_kernel
def respond(rows: Records, memory: Memory) -> None:
    """Carry the responses through the epoch's update and add what its measurements do."""
    covariance, column = memory.covariance, memory.column
    for code in range(memory.responding.size):
        if memory.responding[code] == 0:
            continue
        response = memory.response[code]
        for i in range(SIZE):
            column[i] = 0.0
            for j in range(SIZE):
                column[i] += memory.information[i, j] * response[j]
        for i in range(SIZE):
            response[i] = 0.0
            for j in range(SIZE):
                response[i] += covariance[i, j] * column[j]
    for k in range(rows.size):
        row = rows[k]
        if row.rejection != _USABLE:
            continue
        push = memory.weight[k] * np.sqrt(row.variance_m2 + row.residual_m * row.residual_m)
        memory.responding[row.satellite] = 1
        response, c = memory.response[row.satellite], CLOCK + row.system
        for i in range(SIZE):
            along = covariance[i, 0] * row.line_x + covariance[i, 1] * row.line_y + covariance[i, 2] * row.line_z
            response[i] += push * (covariance[i, c] - along)


@inner_kernel
def largest_variance(east: float, cross: float, north: float) -> float:
    """Larger eigenvalue of a symmetric matrix of two rows."""
    half = 0.5 * (east - north)
    return float(0.5 * (east + north) + np.sqrt(half * half + cross * cross))


@inner_kernel
def horizontal_variance_m2(matrix: Float64s, level: Float64s) -> float:
    """Largest horizontal variance of a covariance whose first three unknowns are the place."""
    east, cross, north = 0.0, 0.0, 0.0
    for i in range(3):
        for j in range(3):
            east += level[0, i] * matrix[i, j] * level[0, j]
            cross += level[0, i] * matrix[i, j] * level[1, j]
            north += level[1, i] * matrix[i, j] * level[1, j]
    return largest_variance(east, cross, north)


@inner_kernel
def bias_variance_m2(memory: Memory) -> float:
    """Largest horizontal variance by satellites that have always been late; forgets responses that died away."""
    east, cross, north, level = 0.0, 0.0, 0.0, memory.level
    for code in range(memory.responding.size):
        if memory.responding[code] == 0:
            continue
        response = memory.response[code]
        eastwards = level[0, 0] * response[0] + level[0, 1] * response[1] + level[0, 2] * response[2]
        northwards = level[1, 0] * response[0] + level[1, 1] * response[1] + level[1, 2] * response[2]
        east += eastwards * eastwards
        cross += eastwards * northwards
        north += northwards * northwards
        if abs(eastwards) + abs(northwards) < FORGOTTEN_M:
            memory.responding[code] = 0
            response[:] = 0.0
    return largest_variance(east, cross, north)


@inner_kernel
def take_excess(rows: Records, memory: Memory, dt_s: float) -> None:
    """Root mean square of the weighted normalised residuals, the good signals counting most; held and decaying."""
    above, below, least = 0.0, 1e-12, UNINFORMED
    for k in range(rows.size):
        row = rows[k]
        if row.rejection == _USABLE:
            square = row.residual_m * row.residual_m / row.variance_m2
            above += (FREEDOM + 1.0) * square / (FREEDOM + square) / np.sqrt(row.variance_m2)
            below += 1.0 / np.sqrt(row.variance_m2)
            if np.isfinite(row.range_rate_mps) and np.isfinite(row.strength_dbhz):
                least = 1.0
    now = memory.now[0]
    held = 1.0 + max(now.excess - 1.0, 0.0) * np.exp(-dt_s / EXCESS_HELD_S)
    now.excess = max(np.sqrt(above / below), held, least)


@inner_kernel
def bound_m(memory: Memory, rules: Any, moved_m: float) -> float:  # noqa: ANN401 - numba record
    """Horizontal bound of the present state [m]."""
    now = memory.now[0]
    settled_s = max(now.determined_s - now.started_s, 0.0)
    fresh = now.excess * (1.0 + UNSETTLED * np.exp(-settled_s / SETTLING_S))
    variance = horizontal_variance_m2(memory.covariance, memory.level) + memory.now[0].common_m * memory.now[0].common_m
    variance += fresh * fresh * bias_variance_m2(memory)
    return float(rules.bound_factor * np.sqrt(variance) + moved_m)
