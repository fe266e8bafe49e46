"""Curvature of the track from yaw rate and speed, with the distance delayed like it.

κ = mean yaw rate / mean speed over one window; its place is the mean of the distances in the window. Landmarks are
matched by it, so both must lag alike (2 s: 1.3 m spread of a curve's crossing against 15 m with a live counter).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from services.numerics.kernel import kernel
from services.odometry_fusion.motion_log import Floats

WINDOW_TICKS: Final = 20
"""2 s at 10 Hz."""
LEAST_MPS: Final = 10.0 / 3.6
"""Iwata et al., section 3.2: no corrections below 10 km/h."""
GYRO_SIGMA_RADPS: Final = float(np.radians(0.02))
"""Yaw rate left in a mean over the window once the bias is removed at rest: vibration and drift."""
SCALE_SIGMA: Final = 0.01
"""Relative error of the wheel's speed."""


@kernel
def curvature_rows(yaw_radps: Floats, distance_m: Floats, usable: Floats, first: int, out: Floats) -> None:
    """Rows (κ [1/m], its standard deviation, its distance [m]) for ticks from `first` on into `out`, shape (n, 3).

    Yaw is positive to the left. NaN below LEAST_MPS, and where any tick of the window is not usable (0). `distance_m`
    may fall in reverse running: the curvature stays that of the track in the sense of forward running.
    """
    for at in range(first, len(yaw_radps)):
        row = at - first
        out[row, 0] = out[row, 1] = out[row, 2] = math.nan
        if at < WINDOW_TICKS:
            continue
        turned = middle = 0.0
        good = True
        for k in range(at - WINDOW_TICKS + 1, at + 1):
            turned += yaw_radps[k]
            middle += 0.5 * (distance_m[k] + distance_m[k - 1])
            good = good and usable[k] > 0.0
        way_m = distance_m[at] - distance_m[at - WINDOW_TICKS]
        speed_mps = way_m / (WINDOW_TICKS * 0.1)
        if not good or abs(speed_mps) < LEAST_MPS:
            continue
        curvature = turned / WINDOW_TICKS / speed_mps
        out[row, 0] = curvature
        out[row, 1] = math.hypot(GYRO_SIGMA_RADPS / speed_mps, SCALE_SIGMA * curvature)
        out[row, 2] = middle / WINDOW_TICKS
