"""The robust filter between two epochs: motion, and the receiver's clocks set anew.

Motion: constant velocity, driven by white acceleration. Clocks follow their drift; then all
are shifted alike by the median residual and given a common variance of (100 m)², so that a jump
of whole milliseconds, or whatever else a receiver does to its clock, leaves no trace in the
place, while the offsets between constellations, which do not jump, stay known.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from services.gnss_correction.atmosphere import LIGHT_MPS
from services.gnss_correction.clock_jump import MILLISECOND_M
from services.gnss_correction.line_of_sight import EARTH_RATE_RADPS
from services.gnss_correction.rejection import Rejection
from services.gnss_correction.robust_state import CLOCK, DRIFT, SIZE, VELOCITY, Memory
from services.gnss_correction.solver_arrays import MOST_SYSTEMS, Float64s, Records
from services.numerics.kernel import inner_kernel, kernel

CLIMB_SHARE: Final = 0.1
"""Vertical acceleration against horizontal: vehicles stay on the ground."""
CLOCK_SIGMA_M: Final = 100.0
"""How far the median residual may be off among reflections."""
OFFSET_NOISE_M: Final = 0.1
"""Wander of the offset between two constellations' clocks per root second: temperature of the receiver."""
DRIFT_NOISE_MPS: Final = 10.0
"""Wander of a receiver clock's drift per root second; Doppler tells it anew at every epoch."""
FRESH_CLOCK_M2: Final = 1e4

_USABLE = int(Rejection.USABLE)


@kernel
def _move(vector: Any, dt_s: float) -> None:  # noqa: ANN401 - numba array
    """Transition of a state, or of a column of its covariance, over `dt_s`."""
    for i in range(3):
        vector[i] += dt_s * vector[VELOCITY + i]
    for system in range(MOST_SYSTEMS):
        vector[CLOCK + system] += dt_s * vector[DRIFT]


@kernel
def predict(memory: Memory, dt_s: float, acceleration_mps2: float) -> None:
    """Carry state, covariance and responses over `dt_s`; `memory.level` holds the local directions."""
    covariance, up = memory.covariance, memory.level[2]
    _move(memory.state, dt_s)
    for i in range(SIZE):
        _move(covariance[:, i], dt_s)
    for i in range(SIZE):
        _move(covariance[i], dt_s)
    along = acceleration_mps2 * acceleration_mps2 * dt_s
    climb = along * CLIMB_SHARE * CLIMB_SHARE
    for i in range(3):
        for j in range(3):
            noise = (climb - along) * up[i] * up[j] + (along if i == j else 0.0)
            covariance[VELOCITY + i, VELOCITY + j] += noise
            covariance[i, VELOCITY + j] += noise * dt_s / 2.0
            covariance[VELOCITY + i, j] += noise * dt_s / 2.0
            covariance[i, j] += noise * dt_s * dt_s / 3.0
    covariance[DRIFT, DRIFT] += DRIFT_NOISE_MPS * DRIFT_NOISE_MPS * dt_s
    for i in range(CLOCK, SIZE):
        covariance[i, i] += OFFSET_NOISE_M * OFFSET_NOISE_M * dt_s
        for j in range(CLOCK, SIZE):
            covariance[i, j] += CLOCK_SIGMA_M * CLOCK_SIGMA_M
    for code in range(memory.responding.size):
        if memory.responding[code] == 1:
            _move(memory.response[code], dt_s)


@inner_kernel
def _median(sample: Float64s, count: int) -> float:
    ordered = np.sort(sample[:count])
    return float(0.5 * (ordered[count // 2] + ordered[(count - 1) // 2]))


@kernel
def range_rate_residual_mps(row: Any, state: Float64s) -> float:  # noqa: ANN401 - numba record
    """Measured minus modelled range rate of a row."""
    turn_mps = EARTH_RATE_RADPS / LIGHT_MPS * (row.vx_mps * state[1] - row.vy_mps * state[0])
    along_mps = (
        row.line_x * (row.vx_mps - state[VELOCITY])
        + row.line_y * (row.vy_mps - state[VELOCITY + 1])
        + row.line_z * (row.vz_mps - state[VELOCITY + 2])
    )
    return float(row.range_rate_mps - (along_mps + turn_mps - row.drift_mps) - state[DRIFT])


@inner_kernel
def _meet(rows: Records, memory: Memory, system: int) -> None:
    """Begin the clock of a constellation that was not seen before, or leave it unknown."""
    count, c = 0, CLOCK + system
    for row in rows:
        if row.rejection == _USABLE and row.system == system:
            memory.sample[count] = row.pseudorange_m - row.modelled_m
            count += 1
    memory.covariance[c, :] = 0.0
    memory.covariance[:, c] = 0.0
    memory.covariance[c, c] = FRESH_CLOCK_M2
    memory.state[c] = 0.0
    if count > 0:
        memory.state[c] = _median(memory.sample, count)
        memory.clock_known[system] = 1


@inner_kernel
def recentre(rows: Records, memory: Memory) -> None:
    """Shift all clocks by the median residual of their pseudoranges, and the drift by that of the Dopplers."""
    state, count = memory.state, 0
    for row in rows:
        if row.rejection == _USABLE and memory.clock_known[row.system] == 1:
            memory.sample[count] = row.pseudorange_m - row.modelled_m - state[CLOCK + row.system]
            count += 1
    shift_m = _median(memory.sample, count) if count > 0 else 0.0
    memory.now[0].clock_step_m = shift_m - np.round(shift_m / MILLISECOND_M) * MILLISECOND_M
    for system in range(MOST_SYSTEMS):
        state[CLOCK + system] += shift_m
        if memory.clock_known[system] == 0:
            _meet(rows, memory, system)
    count = 0
    for row in rows:
        if row.rejection == _USABLE and np.isfinite(row.range_rate_mps):
            memory.sample[count] = range_rate_residual_mps(row, state)
            count += 1
    if count > 0:
        state[DRIFT] += _median(memory.sample, count)
