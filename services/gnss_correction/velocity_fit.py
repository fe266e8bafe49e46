"""Velocity of a receiver at one epoch from Doppler, by weighted least squares.

Range rate: D = e (vs - v) + Sagnac rate + c (d_r - d_s), the time derivative of the
pseudorange; unknown are the velocity and one receiver clock drift for all constellations.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from services.gnss_correction.atmosphere import LIGHT_MPS
from services.gnss_correction.line_of_sight import EARTH_RATE_RADPS
from services.gnss_correction.normal_equations import factorise, solve_factorised
from services.gnss_correction.rejection import Rejection
from services.gnss_correction.solver_arrays import Float64s, Records, Workspace
from services.gnss_correction.weighting import doppler_variance_m2ps2
from services.numerics.kernel import kernel

_USABLE = int(Rejection.USABLE)
_UNKNOWNS = 4


@kernel
def fit_velocity(rows: Records, solution: Any, place: Float64s, work: Workspace) -> None:  # noqa: ANN401 - numba record
    """Velocity into `solution`, from the satellites that made the position; NaN with fewer than four Dopplers.

    `solution` knows latitude and longitude of `place` (3,), Earth-fixed.
    """
    normal, right = work.normal, work.right
    for p in range(_UNKNOWNS):
        right[p] = 0.0
        for q in range(_UNKNOWNS):
            normal[p, q] = 0.0
    count = 0
    for row in rows:
        if row.rejection != _USABLE or not np.isfinite(row.range_rate_mps):
            continue
        turn_mps = EARTH_RATE_RADPS / LIGHT_MPS * (row.vx_mps * place[1] - row.vy_mps * place[0])
        along_mps = row.line_x * row.vx_mps + row.line_y * row.vy_mps + row.line_z * row.vz_mps
        difference_mps = row.range_rate_mps - (along_mps + turn_mps - row.drift_mps)
        weight = 1.0 / doppler_variance_m2ps2(row.strength_dbhz)
        line = (row.line_x, row.line_y, row.line_z)
        count += 1
        for p in range(3):
            for q in range(p + 1):
                normal[p, q] += weight * line[p] * line[q]
            normal[3, p] -= weight * line[p]
            right[p] -= weight * line[p] * difference_mps
        normal[3, 3] += weight
        right[3] += weight * difference_mps
    size = min(_UNKNOWNS, right.size)  # a bare constant would have the solver compiled once more
    if count >= size and factorise(normal, size):
        solve_factorised(normal, size, right)
        sin_lat, cos_lat = np.sin(solution.lat_rad), np.cos(solution.lat_rad)
        sin_lon, cos_lon = np.sin(solution.lon_rad), np.cos(solution.lon_rad)
        outwards_mps = cos_lon * right[0] + sin_lon * right[1]
        solution.ve_mps = cos_lon * right[1] - sin_lon * right[0]
        solution.vn_mps = cos_lat * right[2] - sin_lat * outwards_mps
        solution.vu_mps = cos_lat * outwards_mps + sin_lat * right[2]
