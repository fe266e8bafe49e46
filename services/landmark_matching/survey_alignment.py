"""Lays a run's curves onto the line: how far the odometry's distance is from the line's places, curve by curve.

The offset o_k at curve k is held by the line's geometry with its accuracy, and by the odometry from curve to
curve: o_(k+1) = o_k + e d + noise, with the wheel's scale error e and a noise that grows with the way d and
with slips between. Least squares over all of them; so a single curve that the line file has wrong is moved by
its neighbours, and a slip moves only what lies behind it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

WANDER_SHARE: Final = 5e-4
"""Error of the odometry between two curves once the wheel's scale is known, as a share of the way."""
CROSSING_M: Final = 1.0
"""Noise of one curve's place."""
SCALE_SIGMA: Final = 0.02


@dataclass(frozen=True, slots=True)
class Aligned:
    """Offsets to add to the odometry's distance, shape (n,), and their standard deviations."""

    offset_m: Floats
    sigma_m: Floats
    scale: float
    """True over measured way."""


def align(distance_m: Floats, place_m: Floats, accuracy_m: Floats, excess_m: Floats) -> Aligned:
    """Offsets at the curves of one run, in order; `place_m` by the line's geometry with its accuracy (3 sigma)."""
    count = len(distance_m)
    rows, wanted = [], []
    for k in range(count):
        row = np.zeros(count + 1)
        weight = 3.0 / max(float(accuracy_m[k]), 0.3)
        row[k] = weight
        rows.append(row)
        wanted.append(weight * float(place_m[k] - distance_m[k]))
    for k in range(count - 1):
        way_m = float(distance_m[k + 1] - distance_m[k])
        slips_m = float(excess_m[k + 1] - excess_m[k])
        weight = 1.0 / float(np.sqrt((WANDER_SHARE * way_m) ** 2 + 2.0 * CROSSING_M**2 + slips_m**2))
        row = np.zeros(count + 1)
        row[k], row[k + 1], row[count] = -weight, weight, -weight * way_m
        rows.append(row)
        wanted.append(0.0)
    row = np.zeros(count + 1)
    row[count] = 1.0 / SCALE_SIGMA
    rows.append(row)
    wanted.append(0.0)
    design = np.array(rows)
    normal = design.T @ design
    solution = np.linalg.solve(normal, design.T @ np.array(wanted))
    covariance = np.linalg.inv(normal)
    return Aligned(solution[:count], np.sqrt(np.diag(covariance)[:count]), 1.0 + float(solution[count]))
