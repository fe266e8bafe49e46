"""Position of a receiver at one epoch by iterated weighted least squares.

Pseudorange: P = |xs - x| + Sagnac + c (dt_r,system - dt_s) + I + T (IS-GPS-200, 20.3.3.4.3.3);
unknown are the position and one receiver clock per constellation, so that offsets between the
constellations' times cancel and a satellite alone in its system tells nothing of the place.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from services.gnss_correction.line_of_sight import delay_m, direct, look
from services.gnss_correction.normal_equations import factorise, solve_factorised
from services.gnss_correction.rejection import Outcome, Rejection
from services.gnss_correction.solver_arrays import MOST_SYSTEMS, Float64s, Ints, Records, Workspace
from services.gnss_correction.weighting import cn0_variance_m2, corrected_variance_m2, elevation_variance_m2
from services.numerics.geodesy import geodetic_from_ecef
from services.numerics.kernel import kernel

CONVERGED_M: Final = 1e-4
MOST_ROUNDS: Final = 20
NEAR_M: Final = 10_000.0
"""After a step below this the place is good enough for directions, delays and weights."""
DEEP_M: Final = 6.0e6
"""No place is nearer to the Earth's centre."""
REWEIGHTINGS: Final = 4
"""Rounds after which mask and weights stay as they are, so that nothing flickers at the mask."""

geodetic = kernel(geodetic_from_ecef)

_USABLE = int(Rejection.USABLE)
_WEAK, _LOW, _ALONE = int(Rejection.WEAK_SIGNAL), int(Rejection.BELOW_MASK), int(Rejection.ALONE_IN_SYSTEM)
_FIX, _FEW = int(Outcome.FIX), int(Outcome.TOO_FEW_SATELLITES)
_GEOMETRY, _ASTRAY = int(Outcome.WEAK_GEOMETRY), int(Outcome.NOT_CONVERGED)


@kernel
def _mask_and_weigh(row: Any, rules: Any) -> None:  # noqa: ANN401 - numba records
    """Leave a row out when it is low or weak, take it back when it is not, and give it its variance."""
    if row.rejection in (_LOW, _WEAK, _ALONE):
        row.rejection = _USABLE
    if row.rejection == _USABLE:
        if row.elevation_rad < rules.elevation_mask_rad:
            row.rejection = _LOW
        elif row.strength_dbhz < rules.cn0_mask_dbhz:
            row.rejection = _WEAK
    if rules.by_cn0 == 1 and row.correction_sigma_m > 0.0:
        row.variance_m2 = corrected_variance_m2(row)
    elif rules.by_cn0 == 1:
        row.variance_m2 = cn0_variance_m2(row.elevation_rad, row.strength_dbhz)
    else:
        row.variance_m2 = elevation_variance_m2(row.elevation_rad)


@kernel
def _assign_clocks(rows: Records, column: Ints) -> tuple[int, int]:
    """Number of usable rows and of unknowns, once constellations with a single satellite are left out."""
    for system in range(MOST_SYSTEMS):
        column[system] = 0
    for row in rows:
        if row.rejection == _ALONE:
            row.rejection = _USABLE
        if row.rejection == _USABLE:
            column[row.system] += 1
    count, size = 0, 3
    for system in range(MOST_SYSTEMS):
        seen = column[system]
        column[system] = size if seen > 1 else -1
        if seen > 1:
            size += 1
            count += seen
    for row in rows:
        if row.rejection == _USABLE and column[row.system] < 0:
            row.rejection = _ALONE
    return count, size


@kernel
def accumulate(rows: Records, work: Workspace, size: int) -> None:
    """Normal matrix and right-hand side about the present place (clocks counted from zero)."""
    normal, right = work.normal, work.right
    for p in range(size):
        right[p] = 0.0
        for q in range(size):
            normal[p, q] = 0.0
    for row in rows:
        if row.rejection != _USABLE:
            continue
        c = work.column[row.system]
        weight = 1.0 / row.variance_m2
        difference_m = row.pseudorange_m - row.modelled_m
        line = (row.line_x, row.line_y, row.line_z)
        for p in range(3):
            for q in range(p + 1):
                normal[p, q] += weight * line[p] * line[q]
            normal[c, p] -= weight * line[p]
            right[p] -= weight * line[p] * difference_m
        normal[c, c] += weight
        right[c] += weight * difference_m
    if work.held[0] > 0.0:
        for p in range(3):
            right[p] += work.held[0] * work.held[3 + p] * work.held[2]
            for q in range(p + 1):
                normal[p, q] += work.held[0] * work.held[3 + p] * work.held[3 + q]


@kernel
def _model(
    rows: Records,
    tow_s: float,
    rules: Any,  # noqa: ANN401 - numba record
    place: Float64s,
    near: bool,  # noqa: FBT001 - kernels take no keywords
    weigh: bool,  # noqa: FBT001 - the same
    held: Float64s,
) -> None:
    """What each pseudorange should be at `place`; with directions and delays once that is `near` the truth."""
    level = geodetic(place[0], place[1], place[2])
    held[2] = held[1] - level[2]
    held[3], held[4] = np.cos(level[0]) * np.cos(level[1]), np.cos(level[0]) * np.sin(level[1])
    held[5] = np.sin(level[0])
    for row in rows:
        look(row, place)
        if not near:
            row.variance_m2 = 1.0
            continue
        direct(row, level)
        row.modelled_m += delay_m(row, level, tow_s, rules)
        if weigh:
            _mask_and_weigh(row, rules)


@kernel
def _step(rows: Records, place: Float64s, work: Workspace, size: int) -> float:
    """One Gauss-Newton step of `place`; its length [m], NaN where the geometry gives none."""
    accumulate(rows, work, size)
    if not factorise(work.normal, size):
        return np.nan
    solve_factorised(work.normal, size, work.right)
    square_m2 = 0.0
    for p in range(3):
        place[p] += work.right[p]
        square_m2 += work.right[p] * work.right[p]
    return float(np.sqrt(square_m2))


@kernel
def locate(
    rows: Records,
    tow_s: float,
    rules: Any,  # noqa: ANN401 - numba record
    place: Float64s,
    work: Workspace,
) -> tuple[int, int, int]:
    """Improve `place` (3,) until it stands still; gives the outcome, the usable rows and the unknowns.

    A start far below the ground, as at the Earth's centre, is taken for not knowing where.
    """
    for row in rows:
        if row.rejection in (_LOW, _WEAK, _ALONE):
            row.rejection = _USABLE
    near = place[0] * place[0] + place[1] * place[1] + place[2] * place[2] > DEEP_M * DEEP_M
    refined, count, size = 0, 0, 0
    for _ in range(MOST_ROUNDS):
        _model(rows, tow_s, rules, place, near, refined < REWEIGHTINGS, work.held)
        count, size = _assign_clocks(rows, work.column)
        if count < size or count == 0:
            return _FEW, count, size
        step_m = _step(rows, place, work, size)
        if not np.isfinite(step_m):
            return _GEOMETRY, count, size
        if near and step_m < CONVERGED_M:
            return _FIX, count, size
        refined += near
        near = step_m < NEAR_M
    return _ASTRAY, count, size
