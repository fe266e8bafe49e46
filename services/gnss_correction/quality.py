"""How good a converged solution is: dilution of precision and standard deviation."""

from __future__ import annotations

from typing import Any

import numpy as np

from services.gnss_correction.normal_equations import factorise, spread_of_position
from services.gnss_correction.position_fit import accumulate, geodetic
from services.gnss_correction.rejection import Rejection
from services.gnss_correction.solver_arrays import Float64s, Records, Workspace
from services.numerics.kernel import kernel

_USABLE = int(Rejection.USABLE)


@kernel
def judge(rows: Records, solution: Any, size: int, place: Float64s, work: Workspace) -> None:  # noqa: ANN401 - numba record
    """Clock, dilution of precision and standard deviation of a converged solution with `size` unknowns.

    `work` holds the factor and the clocks of the last round, `rows` the residuals. Dilution counts
    every satellite alike, and a held height as one more; the standard deviation is that of the
    weights, times the root of the mean square weighted residual where that is above one.
    """
    level = geodetic(place[0], place[1], place[2])
    up = (np.cos(level[0]) * np.cos(level[1]), np.cos(level[0]) * np.sin(level[1]), np.sin(level[0]))
    solution.clock_m = work.right[3]
    cost, count = 0.0, 0
    for row in rows:
        if row.rejection == _USABLE:
            cost += row.residual_m * row.residual_m / row.variance_m2
            count += 1
    horizontal_m2, _ = spread_of_position(work.normal, size, up, work.spare)
    scale = max(1.0, cost / (count - size)) if count > size else 1.0
    solution.sigma_horizontal_m = np.sqrt(scale * horizontal_m2)
    for row in rows:
        row.variance_m2 = 1.0
    work.held[0] = 1.0 if work.held[0] > 0.0 else 0.0
    accumulate(rows, work, size)
    if factorise(work.normal, size):
        horizontal, whole = spread_of_position(work.normal, size, up, work.spare)
        solution.hdop, solution.pdop = np.sqrt(horizontal), np.sqrt(whole)
