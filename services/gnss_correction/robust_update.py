"""The robust filter at an epoch: pseudoranges and Dopplers taken in together, by iterated weights.

Of the state x with prediction x0 and its covariance P0, minimised is

    (x - x0)ᵀ P0⁻¹ (x - x0) + Σ ρ(z_i),   z = residual / standard deviation,

with the cost ρ of Student's t, by weighted least squares repeated with the weights
(ν + 1)/(ν + z²) of the round before; the first two rounds use the convex cost of
Huber 1964 instead, so that a wrong prediction can be left. With all weights at 1 this is the
update of the (iterated, extended) Kalman filter in information form (Bar-Shalom et al. 2001, 7.2.3
and 10.5.2).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from services.gnss_correction.line_of_sight import delay_m, direct, look
from services.gnss_correction.normal_equations import factorise, solve_factorised
from services.gnss_correction.position_fit import geodetic
from services.gnss_correction.rejection import Rejection
from services.gnss_correction.robust_noise import measurement_weight, urban_doppler_variance_m2ps2
from services.gnss_correction.robust_prediction import range_rate_residual_mps
from services.gnss_correction.robust_state import CLOCK, DRIFT, SIZE, VELOCITY, Memory
from services.gnss_correction.solver_arrays import Float64s, Records
from services.numerics.kernel import inner_kernel, kernel

MOST_ROUNDS: Final = 7
CONVEX_ROUNDS: Final = 2
EQUAL_M: Final = 15.0
UNSETTLED_S: Final = 30.0
"""Added to every standard deviation in the convex rounds so long after a start: the many decide where to begin, not
the strongest one."""
STILL_M: Final = 1e-3
FAR_M: Final = 200.0
"""Beyond, ranges are computed anew; a straight line over less is off by a millimetre."""
CORRELATION_S: Final = 0.2
"""Errors of a pseudorange last at least so long: of epochs that follow faster each counts for less."""
SHORTEST_S: Final = 0.01
CLIMB_FLOOR_MPS: Final = 0.2
STEEPEST: Final = 0.05
"""Vertical speed of a vehicle: 50 per mille of its speed and a little more (mountain railways reach 70)."""
CLIMB_S: Final = 10.0
"""Gradients last so long; the vertical speed is told once in this time."""

_USABLE = int(Rejection.USABLE)


@inner_kernel
def model(rows: Records, place: Float64s, level: tuple[float, float, float], tow_s: float, rules: Any) -> None:  # noqa: ANN401 - numba record
    """What every pseudorange should be at `place`, without the receiver's clock, and its direction."""
    for row in rows:
        look(row, place)
        direct(row, level)
        row.modelled_m += delay_m(row, level, tow_s, rules)


@inner_kernel
def _shift(rows: Records, step: Float64s) -> None:
    """What the pseudoranges should be after a step of the place that is short against the orbits' height."""
    for row in rows:
        row.modelled_m -= row.line_x * step[0] + row.line_y * step[1] + row.line_z * step[2]


@kernel
def _take_code(row: Any, weight: float, memory: Memory) -> None:  # noqa: ANN401 - numba record
    """Add a pseudorange to the normal equations."""
    normal, right, c = memory.normal, memory.right, CLOCK + row.system
    line = (-row.line_x, -row.line_y, -row.line_z)
    for i in range(3):
        for j in range(3):
            normal[i, j] += weight * line[i] * line[j]
        normal[c, i] += weight * line[i]
        normal[i, c] += weight * line[i]
        right[i] += weight * line[i] * row.residual_m
    normal[c, c] += weight
    right[c] += weight * row.residual_m


@inner_kernel
def _take_rate(row: Any, residual_mps: float, weight: float, memory: Memory) -> None:  # noqa: ANN401 - numba record
    """Add a Doppler to the normal equations."""
    normal, right = memory.normal, memory.right
    line = (-row.line_x, -row.line_y, -row.line_z)
    for i in range(3):
        for j in range(3):
            normal[VELOCITY + i, VELOCITY + j] += weight * line[i] * line[j]
        normal[DRIFT, VELOCITY + i] += weight * line[i]
        normal[VELOCITY + i, DRIFT] += weight * line[i]
        right[VELOCITY + i] += weight * line[i] * residual_mps
    normal[DRIFT, DRIFT] += weight
    right[DRIFT] += weight * residual_mps


@kernel
def _take_prediction(memory: Memory, dt_s: float) -> None:
    """Begin the normal equations: the prediction, and that a vehicle hardly climbs."""
    state, up = memory.state, memory.level[2]
    memory.normal[:, :] = memory.information
    for i in range(SIZE):
        memory.right[i] = 0.0
        for j in range(SIZE):
            memory.right[i] -= memory.information[i, j] * (state[j] - memory.predicted[j])
    speed_mps, climb_mps = 0.0, 0.0
    for i in range(3):
        speed_mps += state[VELOCITY + i] * state[VELOCITY + i]
        climb_mps += up[i] * state[VELOCITY + i]
    limit_mps = CLIMB_FLOOR_MPS + STEEPEST * min(np.sqrt(speed_mps), 100.0)
    weight = min(dt_s / CLIMB_S, 1.0) / (limit_mps * limit_mps)
    for i in range(3):
        memory.right[VELOCITY + i] -= weight * up[i] * climb_mps
        for j in range(3):
            memory.normal[VELOCITY + i, VELOCITY + j] += weight * up[i] * up[j]


@inner_kernel
def _round(rows: Records, memory: Memory, dt_s: float, strongest_dbhz: float, robust: bool) -> float:  # noqa: FBT001 - kernels take no keywords
    """One weighted step of the state; its length in space [m], NaN where the equations have no solution."""
    state = memory.state
    _take_prediction(memory, dt_s)
    unsettled = memory.now[0].t_s - memory.now[0].started_s < UNSETTLED_S
    share = min(max(dt_s, SHORTEST_S) / CORRELATION_S, 1.0)
    for i in range(rows.size):
        row = rows[i]
        if row.rejection != _USABLE:
            continue
        row.residual_m = row.pseudorange_m - row.modelled_m - state[CLOCK + row.system]
        variance = row.variance_m2 + (EQUAL_M * EQUAL_M if unsettled and not robust else 0.0)
        memory.weight[i] = measurement_weight(row.residual_m**2 / variance, robust) * share / variance
        _take_code(row, memory.weight[i], memory)
        if np.isfinite(row.range_rate_mps):
            residual_mps = range_rate_residual_mps(row, state)
            variance = urban_doppler_variance_m2ps2(row.strength_dbhz, strongest_dbhz)
            weight = measurement_weight(residual_mps**2 / variance, robust)
            _take_rate(row, residual_mps, weight / variance, memory)
    if not factorise(memory.normal, SIZE):
        return np.nan
    solve_factorised(memory.normal, SIZE, memory.right)
    for i in range(SIZE):
        state[i] += memory.right[i]
    return float(np.sqrt(memory.right[0] ** 2 + memory.right[1] ** 2 + memory.right[2] ** 2))


@kernel
def invert(matrix: Float64s, factor: Float64s, inverse: Float64s, column: Float64s) -> bool:
    """Inverse of a symmetric positive definite matrix through its `factor`; False where it has none."""
    factor[:, :] = matrix
    if not factorise(factor, SIZE):
        return False
    _unfold(factor, inverse, column)
    return True


@inner_kernel
def _unfold(factor: Float64s, inverse: Float64s, column: Float64s) -> None:
    """Inverse of the matrix of a Cholesky factor, symmetric to the last bit."""
    for j in range(SIZE):
        column[:] = 0.0
        column[j] = 1.0
        solve_factorised(factor, SIZE, column)
        inverse[j] = column
    for i in range(SIZE):
        for j in range(i):
            inverse[i, j] = inverse[j, i] = 0.5 * (inverse[i, j] + inverse[j, i])


@inner_kernel
def update(
    rows: Records,
    memory: Memory,
    tow_s: float,
    dt_s: float,
    strongest_dbhz: float,
    rules: Any,  # noqa: ANN401 - numba record
) -> bool:
    """Take an epoch's usable rows in; False, with the prediction kept, where the equations have no solution."""
    memory.predicted[:] = memory.state
    if not invert(memory.covariance, memory.normal, memory.information, memory.column):
        return False
    for turn in range(MOST_ROUNDS):
        step_m = _round(rows, memory, dt_s, strongest_dbhz, turn >= CONVEX_ROUNDS)
        if not np.isfinite(step_m):
            memory.state[:] = memory.predicted
            return False
        if step_m > FAR_M:
            state = memory.state
            model(rows, state, geodetic(state[0], state[1], state[2]), tow_s, rules)
        else:
            _shift(rows, memory.right)
        if turn > CONVEX_ROUNDS and step_m < STILL_M:
            break
    _unfold(memory.normal, memory.covariance, memory.column)
    return True
