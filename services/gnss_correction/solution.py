"""Positions and velocities of a receiver, epoch after epoch: the one solver for files and for the live service."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from services.gnss_correction.contradiction import CONTRADICTION_M, exclude_contradictions, take_residuals
from services.gnss_correction.line_of_sight import direct, look
from services.gnss_correction.position_fit import geodetic, locate
from services.gnss_correction.quality import judge
from services.gnss_correction.rejection import Outcome
from services.gnss_correction.solver_arrays import Float64s, Ints, Records, Workspace, no_solutions, workspace
from services.gnss_correction.velocity_fit import fit_velocity
from services.numerics.kernel import kernel

LOWEST_PLACE_M: Final = -5_000.0
HIGHEST_PLACE_M: Final = 50_000.0
"""Heights beyond which a solution is no place of a vehicle, with room for bad vertical geometry."""
HELD_HEIGHT_SIGMA_M: Final = 30.0
"""How far a held height may be off: what reflections do to it among buildings, and half a minute of gradient."""

_FIX, _FEW, _GEOMETRY = int(Outcome.FIX), int(Outcome.TOO_FEW_SATELLITES), int(Outcome.WEAK_GEOMETRY)
_ASTRAY, _ABSURD = int(Outcome.NOT_CONVERGED), int(Outcome.ABSURD_PLACE)
_FEWEST = 4


@kernel
def _place_epoch(
    rows: Records,
    solution: Any,  # noqa: ANN401 - numba record
    tow_s: float,
    rules: Any,  # noqa: ANN401 - numba record
    known: Float64s,
    place: Float64s,
    work: Workspace,
) -> int:
    """Position of one epoch, from the last place, or from the Earth's centre where that leads nowhere."""
    outcome, count, size = _ASTRAY, 0, 0
    for attempt in range(2):
        warm = attempt == 0
        if warm and known[3] == 0.0:
            continue
        for p in range(3):
            place[p] = known[p] if warm else 0.0
        outcome, count, size = locate(rows, tow_s, rules, place, work)
        if outcome == _FIX:
            break
    if outcome != _FEW and not take_residuals(rows, work) <= CONTRADICTION_M:
        outcome, count, size = exclude_contradictions(rows, tow_s, rules, place, count - size, work)
    solution.used, solution.needed = count, max(size, _FEWEST)
    if outcome != _FIX:
        return outcome
    judge(rows, solution, size, place, work)
    if not solution.pdop <= rules.most_pdop:
        return _GEOMETRY
    height_m = geodetic(place[0], place[1], place[2])[2]
    return _FIX if LOWEST_PLACE_M < height_m < HIGHEST_PLACE_M else _ABSURD


@kernel
def _hold_height(
    rows: Records,
    solution: Any,  # noqa: ANN401 - numba record
    tow_s: float,
    rules: Any,  # noqa: ANN401 - numba record
    known: Float64s,
    place: Float64s,
    work: Workspace,
) -> int:
    """Solve an epoch of weak geometry with the height of the last good fix as one more measurement."""
    age_s = tow_s - known[4]
    if not 0.0 <= age_s <= rules.longest_hold_s:
        return _GEOMETRY
    weak_pdop = solution.pdop
    work.held[0], work.held[1] = 1.0 / (HELD_HEIGHT_SIGMA_M * HELD_HEIGHT_SIGMA_M), known[5]
    place[0], place[1], place[2] = known[0], known[1], known[2]
    outcome, _, size = locate(rows, tow_s, rules, place, work)
    if outcome == _FIX:
        take_residuals(rows, work)
        judge(rows, solution, size, place, work)
        outcome = _FIX if solution.pdop <= rules.most_pdop else _GEOMETRY
        solution.held_s = age_s
        solution.pdop = weak_pdop
    work.held[0] = 0.0
    return outcome


@kernel
def _look_from_known(rows: Records, known: Float64s) -> None:
    """Directions of an epoch without a fix: from the last known place, none before the first fix."""
    level = geodetic(known[0], known[1], known[2])
    for row in rows:
        row.residual_m, row.elevation_rad, row.azimuth_rad = np.nan, np.nan, np.nan
        if known[3] > 0.0:
            look(row, known)
            direct(row, level)


@kernel
def _solve_block(
    first_row: Ints,
    tow_s: Float64s,
    rows: Records,
    rules: Any,  # noqa: ANN401 - numba record
    known: Float64s,
    solutions: Records,
    work: Workspace,
) -> None:
    place = np.empty(3)
    for epoch in range(tow_s.size):
        seen, solution = rows[first_row[epoch] : first_row[epoch + 1]], solutions[epoch]
        solution.outcome = _place_epoch(seen, solution, tow_s[epoch], rules, known, place, work)
        if solution.outcome == _GEOMETRY:
            solution.outcome = _hold_height(seen, solution, tow_s[epoch], rules, known, place, work)
        if solution.outcome != _FIX:
            _look_from_known(seen, known)
            continue
        solution.lat_rad, solution.lon_rad, solution.h_m = geodetic(place[0], place[1], place[2])
        fit_velocity(seen, solution, place, work)
        known[0], known[1], known[2], known[3] = place[0], place[1], place[2], 1.0
        if np.isnan(solution.held_s):
            known[4], known[5] = tow_s[epoch], solution.h_m


class Solver:
    """Solves blocks of epochs; remembers the last place, to start from it and to know directions without a fix."""

    def __init__(self) -> None:
        """Know no place yet."""
        self._known = np.array([0.0, 0.0, 0.0, 0.0, -np.inf, 0.0])
        """Last place (3), whether there is one, time and height of the last fix that held no height."""
        self._work = workspace()

    def solve(self, first_row: Ints, tow_s: Float64s, rows: Records, rules: np.void) -> Records:
        """Solutions (dtype SOLUTION) of the epochs whose `rows` (dtype ROW) are `first_row[i]:first_row[i + 1]`.

        Completes `rows` in place: rejections, directions, residuals. Rows rejected before take no
        part; the others must have finite pseudoranges and satellites. The result does not depend on
        how epochs are divided into blocks.
        """
        solutions = no_solutions(tow_s.size)
        _solve_block(first_row, tow_s, rows, rules, self._known, solutions, self._work)
        return solutions
