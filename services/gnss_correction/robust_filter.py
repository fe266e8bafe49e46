"""Position, velocity and a bound for every epoch by a robust filter over pseudoranges and Dopplers.

An extended Kalman filter with robust weights (robust_update.py) over a vehicle's motion and the
receiver's clocks (robust_prediction.py), with standard deviations after the signals' strength
(robust_noise.py) and a horizontal bound (robust_bound.py). It leaves a wrong state by itself
(robust_doubt.py), goes on through epochs without satellites as a prediction, and is causal.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from schemas.gnss_time import WEEK_S
from services.gnss_correction.position_fit import geodetic
from services.gnss_correction.rejection import Outcome, Rejection
from services.gnss_correction.robust_bound import bound_m, horizontal_variance_m2, respond, take_excess
from services.gnss_correction.robust_doubt import (
    CLOCK_STEP_M,
    covered_m,
    open_when_doubtful,
    take_doubt,
    take_move,
)
from services.gnss_correction.robust_noise import USUAL_STRONGEST_DBHZ, urban_code_variance_m2
from services.gnss_correction.robust_prediction import predict, recentre
from services.gnss_correction.robust_state import (
    CLOCK,
    DRIFT,
    FILTER_RULES,
    ROBUST_SOLUTION,
    SIZE,
    VELOCITY,
    Memory,
    no_memory,
)
from services.gnss_correction.robust_update import model, update
from services.gnss_correction.solver_arrays import MOST_SYSTEMS, Bools, Float64s, Ints, Records
from services.numerics.geodesy import ecef_from_geodetic
from services.numerics.kernel import kernel

START_M: Final = 100.0
START_MPS: Final = 20.0
START_DRIFT_MPS: Final = 1_000.0
START_SIGMAS: Final = 3.0
"""How far a first solution may be off, and by how many of its own standard deviations more."""
FRESH_S: Final = 30.0
"""After so long without satellites enough the filter starts again from the first solution there is."""
COASTING_S: Final = 10.0
"""For so long fewer satellites than determine a place may help the motion along to a fix."""
BLIND_S: Final = 1.5
BLIND_SHARE: Final = 2.5
"""Acceleration of a vehicle that nobody observes any more: it brakes or starts for as long as it likes."""
FASTEST_MPS: Final = 150.0
"""No train has gone faster, except one: the bound of a prediction grows no faster."""
STRONGEST_HELD_S: Final = 300.0
STRONG_RANK: Final = 2
"""The second strongest signal stands for the strongest, lest one odd channel does."""

_ecef = kernel(ecef_from_geodetic)
_USABLE, _LOW = int(Rejection.USABLE), int(Rejection.BELOW_MASK)
_WEAK, _ALONE, _CONTRADICTS = (
    int(Rejection.WEAK_SIGNAL),
    int(Rejection.ALONE_IN_SYSTEM),
    int(Rejection.CONTRADICTS),
)
_FIX, _PREDICTED, _FEW = int(Outcome.FIX), int(Outcome.PREDICTED), int(Outcome.TOO_FEW_SATELLITES)
_ENOUGH = 3
"""Satellites beyond one per constellation that determine a place."""


class RobustInput(NamedTuple):
    """A block of epochs of one receiver."""

    first_row: Ints
    """Rows of epoch i are `first_row[i]:first_row[i + 1]`."""
    t_s: Float64s
    """GPS time since its first week began."""
    refused: Bools
    rows: Records
    """Dtype ROW."""
    first_solutions: Records
    """Dtype SOLUTION: every epoch by itself, to start from."""


def seconds_of_week(gps_week: int) -> float:
    """GPS time at which a week began."""
    return gps_week * float(WEEK_S)


@kernel
def _start(memory: Memory, first: Any, t_s: float) -> None:  # noqa: ANN401 - numba record
    """Begin from the solution of one epoch."""
    now = memory.now[0]
    place = _ecef(first.lat_rad, first.lon_rad, first.h_m)
    memory.state[:] = 0.0
    memory.covariance[:, :] = 0.0
    memory.response[:, :] = 0.0
    memory.responding[:] = 0
    memory.clock_known[:] = 0
    spread_m = START_M + START_SIGMAS * first.sigma_horizontal_m
    for i in range(3):
        memory.state[i] = place[i]
        memory.covariance[i, i] = spread_m * spread_m
        memory.covariance[VELOCITY + i, VELOCITY + i] = START_MPS * START_MPS
    memory.covariance[DRIFT, DRIFT] = START_DRIFT_MPS * START_DRIFT_MPS
    for i in range(CLOCK, SIZE):
        memory.covariance[i, i] = START_M * START_M
    now.started, now.t_s, now.started_s, now.determined_s = 1, t_s, t_s, t_s
    now.doubt_s, now.moved_m, now.excess, now.bound_m, now.bound_s = 0.0, 0.0, 1.0, np.inf, t_s
    if now.strongest_dbhz == 0.0:
        now.strongest_dbhz = USUAL_STRONGEST_DBHZ


@kernel
def _look_around(memory: Memory) -> tuple[float, float, float]:
    """Latitude, longitude and height of the state; east, north and up into `memory.level`."""
    lat_rad, lon_rad, h_m = geodetic(memory.state[0], memory.state[1], memory.state[2])
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(lat_rad), np.cos(lat_rad), np.sin(lon_rad), np.cos(lon_rad)
    level = memory.level
    level[0, 0], level[0, 1], level[0, 2] = -sin_lon, cos_lon, 0.0
    level[1, 0], level[1, 1], level[1, 2] = -sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat
    level[2, 0], level[2, 1], level[2, 2] = cos_lat * cos_lon, cos_lat * sin_lon, sin_lat
    return lat_rad, lon_rad, h_m


@kernel
def _hold_strongest(rows: Records, memory: Memory, dt_s: float) -> None:
    """Follow the strongest signals of the receiver: up at once, down slowly."""
    first_dbhz, second_dbhz, now = 0.0, 0.0, memory.now[0]
    for row in rows:
        if row.strength_dbhz > first_dbhz:
            first_dbhz, second_dbhz = row.strength_dbhz, first_dbhz
        elif row.strength_dbhz > second_dbhz:
            second_dbhz = row.strength_dbhz
    if second_dbhz > 0.0:
        share = 1.0 - np.exp(-dt_s / STRONGEST_HELD_S)
        gap_db = second_dbhz - now.strongest_dbhz
        now.strongest_dbhz += gap_db if gap_db > 0.0 else share * gap_db


@kernel
def _admit(rows: Records, memory: Memory, rules: Any) -> tuple[int, int]:  # noqa: ANN401 - numba record
    """Usable rows, weighed, and how many they are beyond one per constellation."""
    count, systems = 0, 0
    for row in rows:
        if row.rejection in (_LOW, _WEAK, _ALONE, _CONTRADICTS):
            row.rejection = _USABLE
        if row.rejection == _USABLE and row.elevation_rad < rules.elevation_mask_rad:
            row.rejection = _LOW
        if row.rejection == _USABLE and row.strength_dbhz < rules.cn0_mask_dbhz:
            row.rejection = _WEAK
        row.variance_m2 = urban_code_variance_m2(row, memory.now[0].strongest_dbhz)
        if row.rejection == _USABLE:
            count += 1
            systems |= 1 << row.system
    spare = count
    for system in range(MOST_SYSTEMS):
        spare -= (systems >> system) & 1
    return count, spare


@kernel
def _measure(rows: Records, memory: Memory, tow_s: float, dt_s: float, rules: Any, ours: Any) -> tuple[int, int]:  # noqa: ANN401 - numba records
    """Take an epoch in; gives the consistent rows and the outcome."""
    now = memory.now[0]
    level = _look_around(memory)
    acceleration_mps2 = ours.acceleration_mps2
    if now.t_s - now.determined_s > BLIND_S or dt_s > BLIND_S:
        acceleration_mps2 *= BLIND_SHARE
    predict(memory, dt_s, acceleration_mps2)
    level = _look_around(memory)
    model(rows, memory.state, level, tow_s, rules)
    _hold_strongest(rows, memory, dt_s)
    count, spare = _admit(rows, memory, rules)
    now.clock_step_m = 0.0
    if count == 0:
        return 0, _PREDICTED
    recentre(rows, memory)
    opened = open_when_doubtful(memory)
    weighed_s = dt_s if now.t_s > now.started_s else 1.0
    if not update(rows, memory, tow_s, weighed_s, now.strongest_dbhz, rules):
        return 0, _PREDICTED
    if opened:
        take_move(memory)
    respond(rows, memory)
    take_excess(rows, memory, dt_s)
    if spare >= _ENOUGH:
        now.determined_s = now.t_s
    known = now.t_s - now.determined_s <= COASTING_S
    return take_doubt(rows, memory, dt_s), _FIX if known else _PREDICTED


@kernel
def _tell(solution: Any, memory: Memory, ours: Any) -> None:  # noqa: ANN401 - numba records
    """Write the state and its bound into a solution."""
    now, state, level = memory.now[0], memory.state, memory.level
    solution.lat_rad, solution.lon_rad, solution.h_m = _look_around(memory)
    velocity = state[VELOCITY : VELOCITY + 3]
    solution.ve_mps = level[0, 0] * velocity[0] + level[0, 1] * velocity[1]
    solution.vn_mps = level[1, 0] * velocity[0] + level[1, 1] * velocity[1] + level[1, 2] * velocity[2]
    solution.vu_mps = level[2, 0] * velocity[0] + level[2, 1] * velocity[1] + level[2, 2] * velocity[2]
    for system in range(MOST_SYSTEMS - 1, -1, -1):
        if memory.clock_known[system] == 1:
            solution.clock_m = state[CLOCK + system]
    solution.sigma_horizontal_m = np.sqrt(horizontal_variance_m2(memory.covariance, level))
    solution.moved_m = covered_m(memory) if now.t_s - now.moved_s < COASTING_S else 0.0
    solution.clock_step_m = now.clock_step_m if abs(now.clock_step_m) > CLOCK_STEP_M else 0.0
    solution.undetermined_s = now.t_s - now.determined_s
    limit_m = bound_m(memory, ours, covered_m(memory))
    if solution.undetermined_s > 0.0:
        limit_m = min(limit_m, now.bound_m + FASTEST_MPS * (now.t_s - now.bound_s))
    else:
        now.bound_m, now.bound_s = limit_m, now.t_s
    solution.bound_m = limit_m


@kernel
def _run(
    given: RobustInput,
    rules: Any,  # noqa: ANN401 - numba record
    ours: Any,  # noqa: ANN401 - numba record
    memory: Memory,
    solutions: Records,
) -> None:
    now = memory.now[0]
    for epoch in range(given.t_s.size):
        seen = given.rows[given.first_row[epoch] : given.first_row[epoch + 1]]
        solution, first, t_s = solutions[epoch], given.first_solutions[epoch], given.t_s[epoch]
        solution.outcome, solution.needed = _FEW, first.needed
        solution.hdop, solution.pdop = first.hdop, first.pdop
        if given.refused[epoch]:
            continue
        back = now.started == 1 and t_s <= now.t_s
        stale = now.started == 1 and t_s - now.determined_s > FRESH_S
        if now.started == 0 or back or (stale and first.outcome == _FIX):
            now.started = 0
            if first.outcome != _FIX:
                solution.outcome, solution.used = first.outcome, first.used
                continue
            _start(memory, first, t_s)
        dt_s = t_s - now.t_s
        now.t_s = t_s
        solution.used, solution.outcome = _measure(seen, memory, t_s, dt_s, rules, ours)
        _tell(solution, memory, ours)


class RobustFilter:
    """Filters blocks of epochs of one receiver; remembers what is needed from one block to the next."""

    def __init__(self, acceleration_mps2: float, bound_factor: float) -> None:
        """Know nothing yet; settings as in `settings.Config`."""
        self._memory = no_memory()
        self._ours = np.zeros(1, FILTER_RULES)
        self._ours["acceleration_mps2"], self._ours["bound_factor"] = acceleration_mps2, bound_factor

    def solve(self, given: RobustInput, rules: np.void, common_m: float) -> Records:
        """Solutions (dtype ROBUST_SOLUTION) of a block of epochs; completes its rows in place.

        `rules` as for the solver; `common_m` as in robust_bound.py. Epochs that are refused change
        nothing and have no solution. The result does not depend on how epochs are divided into blocks.
        """
        solutions = np.zeros(given.t_s.size, ROBUST_SOLUTION)
        for name in ROBUST_SOLUTION.names or ():
            if ROBUST_SOLUTION[name] == np.float64:
                solutions[name] = np.nan
        self._ours["common_m"] = common_m
        _run(given, rules, self._ours[0], self._memory, solutions)
        return solutions
