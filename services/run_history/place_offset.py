"""What all places of a log are off by, told by where they fall across the line.

A phone's places may lie ten metres north of the track all day. On a stretch that runs east this is seen across the
line; where the line turns north the same offset lies along it, and becomes an error of the place. Two unknowns (east,
north) and the side of the track the train runs on, from the distances across in every direction the line takes:
weighted least squares (Student's t: fixes far aside lose weight) with priors, so that a line which never turns leaves
what it cannot tell at zero.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
OFFSET_SIGMA_M: Final = 10.0
"""What logs are off by as a whole, before anything is known."""
TRACK_SIGMA_M: Final = 2.5
"""From the axis to the track: half of the distance of two tracks."""
ACROSS_SIGMA_M: Final = 7.0
"""Of a fix across the line."""
CORRELATION_S: Final = 100.0
"""Errors of places are alike for about so long: so much of a log counts as one fix."""
MOVING_M: Final = 50.0
"""From one fix that counts to the next: a train that stands says the same again and again."""
PASSES: Final = 8


def common_offset(t_s: Floats, axis_m: Floats, aside_m: Floats, heading_rad: Floats) -> tuple[float, float]:
    """East and north [m] of what a log's places are off by; zeros where nothing can be told.

    `aside_m` is positive to the left of the axis, `heading_rad` clockwise from north; NaN where there is no place.
    Shapes (n,).
    """
    known = np.flatnonzero(np.isfinite(axis_m) & np.isfinite(aside_m))
    if len(known) < 2:  # noqa: PLR2004 - steps between places
        return 0.0, 0.0
    step = np.floor(axis_m[known] / MOVING_M)
    known = known[np.concatenate(([True], np.diff(step) != 0.0))]
    across, heading = aside_m[known], heading_rad[known]
    rows = np.stack((-np.cos(heading), np.sin(heading), np.ones(len(heading))), axis=1)
    apart_s = np.diff(t_s[known], prepend=t_s[known[0]] - CORRELATION_S)
    share = np.minimum(apart_s / CORRELATION_S, 1.0) / ACROSS_SIGMA_M**2
    prior = np.diag((OFFSET_SIGMA_M**-2, OFFSET_SIGMA_M**-2, TRACK_SIGMA_M**-2))
    found = np.zeros(3)
    for _ in range(PASSES):
        off = (across - rows @ found) / ACROSS_SIGMA_M
        weighted = rows.T * (share * 2.0 / (1.0 + off * off))
        found = np.linalg.solve(weighted @ rows + prior, weighted @ across)
    return float(found[0]), float(found[1])


def along_m(offset: tuple[float, float], heading_rad: Floats) -> Floats:
    """How far an offset (east, north) lies along the line [m]; shape of `heading_rad`."""
    return np.asarray(offset[0] * np.sin(heading_rad) + offset[1] * np.cos(heading_rad))
