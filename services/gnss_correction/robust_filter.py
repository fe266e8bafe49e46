"""Position, velocity and a bound for every epoch by a robust filter over pseudoranges and Dopplers.

An extended Kalman filter with robust weights (robust_update.py) over a vehicle's motion and the
receiver's clocks (robust_prediction.py), with standard deviations after the signals' strength
(robust_noise.py) and a horizontal bound (robust_bound.py). It leaves a wrong state by itself
(robust_doubt.py), finds satellites that lead it astray (robust_hypotheses.py), goes on through epochs without
satellites as a prediction, and is causal.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from schemas.gnss_time import WEEK_S
from services.gnss_correction.rejection import Outcome
from services.gnss_correction.robust_bound import bound_m, horizontal_variance_m2
from services.gnss_correction.robust_doubt import CLOCK_STEP_M, covered_m
from services.gnss_correction.robust_epoch import COASTING_S, look_around, measure, start
from services.gnss_correction.robust_hypotheses import Bank, begin, covering_m, follow, leave_out, no_bank, settle
from services.gnss_correction.robust_state import CLOCK, FILTER_RULES, ROBUST_SOLUTION, VELOCITY, Memory, no_memory
from services.gnss_correction.solver_arrays import MOST_SYSTEMS, Bools, Float64s, Ints, Records
from services.numerics.kernel import kernel

FRESH_S: Final = 30.0
"""After so long without satellites enough the filter starts again from the first solution there is."""
FASTEST_MPS: Final = 150.0
"""No train has gone faster, except one: the bound of a prediction grows no faster."""

_FIX, _FEW = int(Outcome.FIX), int(Outcome.TOO_FEW_SATELLITES)


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
    common_m: Float64s
    """Horizontal error that all satellites of the epoch share, as in robust_bound.py."""


def seconds_of_week(gps_week: int) -> float:
    """GPS time at which a week began."""
    return gps_week * float(WEEK_S)


@kernel
def _tell(solution: Any, memory: Memory, bank: Bank, ours: Any, dt_s: float) -> None:  # noqa: ANN401 - numba records
    """Write the state and its bound into a solution."""
    now, state, level = memory.now[0], memory.state, memory.level
    solution.lat_rad, solution.lon_rad, solution.h_m = look_around(memory)
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
    limit_m = covering_m(memory, bank, ours, bound_m(memory, ours, covered_m(memory)), dt_s)
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
    bank: Bank,
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
            start(memory, first, t_s)
            if ours.watched > 0.0:
                begin(seen, memory, bank)
        dt_s = t_s - now.t_s
        now.t_s = t_s
        now.common_m = given.common_m[epoch]
        if ours.watched > 0.0:
            follow(seen, memory, bank, dt_s, rules, ours)
            leave_out(seen, memory)
        solution.used, solution.outcome = measure(seen, memory, dt_s, rules, ours)
        if solution.used > 0 and ours.watched > 0.0:
            settle(seen, memory, bank, dt_s)
        _tell(solution, memory, bank, ours, dt_s)


class RobustFilter:
    """Filters blocks of epochs of one receiver; remembers what is needed from one block to the next."""

    def __init__(self, acceleration_mps2: float, bound_factor: float, *, watched: bool = True) -> None:
        """Know nothing yet; settings as in `settings.Config`.

        Without being `watched` it is quicker and may be led astray by one satellite: good enough as evidence
        about multipath, not for a position that is published.
        """
        self._memory, self._bank = no_memory(), no_bank()
        self._ours = np.zeros(1, FILTER_RULES)
        self._ours["acceleration_mps2"], self._ours["bound_factor"] = acceleration_mps2, bound_factor
        self._ours["watched"] = watched

    def solve(self, given: RobustInput, rules: np.void) -> Records:
        """Solutions (dtype ROBUST_SOLUTION) of a block of epochs; completes its rows in place.

        `rules` as for the solver. Epochs that are refused change
        nothing and have no solution. The result does not depend on how epochs are divided into blocks.
        """
        solutions = np.zeros(given.t_s.size, ROBUST_SOLUTION)
        for name in ROBUST_SOLUTION.names or ():
            if ROBUST_SOLUTION[name] == np.float64:
                solutions[name] = np.nan
        _run(given, rules, self._ours[0], self._memory, self._bank, solutions)
        return solutions
