"""Pseudoranges that cannot be true beside the others: kilometres off, by a wrong ephemeris or a broken decoder.

No reflection is that late. Left in, one of them moves the place by hundreds of metres without
any of the usual signs. With at least two pseudoranges to spare the culprit is the one without
which the others agree best; with fewer nobody can tell, and there is no fix.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from services.gnss_correction.position_fit import locate
from services.gnss_correction.rejection import Outcome, Rejection
from services.gnss_correction.solver_arrays import MOST_SYSTEMS, Float64s, Records, Workspace
from services.numerics.kernel import kernel

CONTRADICTION_M: Final = 1_000.0
"""A residual beyond this is no multipath."""
MOST_CULPRITS: Final = 4
_SPARE: Final = 2

_USABLE, _CONTRADICTS = int(Rejection.USABLE), int(Rejection.CONTRADICTS)
_FIX, _CONTRADICTION = int(Outcome.FIX), int(Outcome.CONTRADICTION)


@kernel
def take_residuals(rows: Records, work: Workspace) -> float:
    """Residuals of all rows against the last round of `locate`; gives the largest of the used ones."""
    for system in range(MOST_SYSTEMS):
        column = work.column[system]
        work.clock_m[system] = work.right[column] if column >= 0 else np.nan
    worst_m = 0.0
    for row in rows:
        row.residual_m = row.pseudorange_m - row.modelled_m - work.clock_m[row.system]
        if row.rejection == _USABLE and not abs(row.residual_m) <= worst_m:
            worst_m = abs(row.residual_m)
    return worst_m


@kernel
def _disagreement_m(rows: Records, tow_s: float, rules: Any, place: Float64s, work: Workspace) -> float:  # noqa: ANN401 - numba record
    """Largest residual of a solution from the Earth's centre; inf where there is none."""
    place[0], place[1], place[2] = 0.0, 0.0, 0.0
    outcome, _, _ = locate(rows, tow_s, rules, place, work)
    return take_residuals(rows, work) if outcome == _FIX else np.inf


@kernel
def _culprit(rows: Records, tow_s: float, rules: Any, place: Float64s, work: Workspace) -> tuple[int, float]:  # noqa: ANN401 - numba record
    """Row without which the others agree best, and their largest residual then; -1 where none helps.

    The row with the largest residual is tried first: mostly it is the one, and that ends the search.
    """
    first, largest_m = 0, -1.0
    for i in range(rows.size):
        if rows[i].rejection == _USABLE and abs(rows[i].residual_m) > largest_m:
            first, largest_m = i, abs(rows[i].residual_m)
    best, smallest_m = -1, np.inf
    for turn in range(rows.size):
        i = (first + turn) % rows.size
        if rows[i].rejection != _USABLE:
            continue
        rows[i].rejection = _CONTRADICTS
        worst_m = _disagreement_m(rows, tow_s, rules, place, work)
        rows[i].rejection = _USABLE
        if worst_m < smallest_m:
            best, smallest_m = i, worst_m
        if turn == 0 and worst_m <= CONTRADICTION_M:
            break
    return best, smallest_m


@kernel
def exclude_contradictions(
    rows: Records,
    tow_s: float,
    rules: Any,  # noqa: ANN401 - numba record
    place: Float64s,
    spare: int,
    work: Workspace,
) -> tuple[int, int, int]:
    """Solve without the pseudoranges that contradict the others; outcome, usable rows and unknowns as `locate`.

    `spare` pseudoranges are there beyond the unknowns; `rows` hold the residuals of the solution
    that showed the contradiction. Leaves the culprits rejected.
    """
    for culprits in range(MOST_CULPRITS):
        if spare - culprits < _SPARE:
            break
        best, smallest_m = _culprit(rows, tow_s, rules, place, work)
        if best < 0:
            break
        rows[best].rejection = _CONTRADICTS
        place[0], place[1], place[2] = 0.0, 0.0, 0.0
        outcome, count, size = locate(rows, tow_s, rules, place, work)
        take_residuals(rows, work)
        if smallest_m <= CONTRADICTION_M:
            return outcome, count, size
    return _CONTRADICTION, 0, 0
