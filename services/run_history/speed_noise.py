"""How much noise of the measured speeds is left in the acceleration, run by run.

What the smoother makes of a receiver's errors is known from their spectra (Wiener 1949). Of two speeds, the measured
one with noise N(ω) (white and wandering) and that of the places with P(ω), ω² times their wandering, the smoother takes
the better at each frequency, together with noise M, 1/M = 1/N + 1/P, and passes W = J / (J + ω⁴ M) of it, J the jerk's
density. In the acceleration (ω W M / N)² N is left of the speeds' noise, and the like of the places'. How large the
white and the wandering part of the speeds are in a run is read from measured less smoothed speed, and from how that
changes from fix to fix. A mean over a window w, differentiated, leaves s²/w².
"""

from __future__ import annotations

from functools import lru_cache
from math import exp, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.run_history.middle import median_of
from services.run_history.track_smoothing import (
    JERK,
    PLACE_WANDER_M,
    PLACE_WANDER_S,
    SPEED_SIGMA_MPS,
    WANDER_MPS,
    WANDER_S,
)

Floats = NDArray[np.float64]
MOVING_MPS: Final = 3.0
FEWEST: Final = 20
SLOWEST: Final = 1e-3
"""Lowest angular frequency of the sums [1/s]; below it next to nothing is left."""
FREQUENCIES: Final = 128


def acceleration_noise_mps2(t_s: Floats, measured_mps: Floats, smoothed_mps: Floats, window_s: float | None) -> float:
    """Standard deviation of the noise in the acceleration of a run; 0 where too few speeds tell. Shapes (n,).

    `smoothed_mps` without sign; `window_s`: width of the moving average, None for the smoother.
    """
    told = np.flatnonzero(np.isfinite(measured_mps) & (smoothed_mps > MOVING_MPS))
    if len(told) < FEWEST:
        return 0.0
    apart_mps = (measured_mps - smoothed_mps)[told]
    whole = (1.483 * median_of(np.abs(apart_mps))) ** 2
    if window_s is not None:
        return sqrt(whole) / window_s
    step_s = round(median_of(np.diff(t_s)), 3)
    # Neighbours differ by twice the white part and by what the wandering part changes in a step.
    changed = 0.5 * (1.483 * median_of(np.abs(np.diff(apart_mps)))) ** 2
    keep = exp(-step_s / WANDER_S)
    white = min(max((changed - (1.0 - keep) * whole) / keep, 0.0), whole)
    of_white, of_wander, of_places = left_mps2(step_s)
    return sqrt(of_white**2 * white + of_wander**2 * (whole - white) + of_places**2 * (whole > 0.0))


@lru_cache(maxsize=64)
def left_mps2(step_s: float) -> tuple[float, float, float]:
    """What the smoother leaves in the acceleration at so many seconds a fix, as standard deviations [m/s²].

    Of white and of wandering errors of the speed of 1 m/s each, and of the places' errors as they are assumed.
    """
    edges = np.geomspace(SLOWEST, np.pi / step_s, FREQUENCIES + 1)
    square = edges[1:] * edges[:-1]
    width = np.diff(edges) / np.pi  # both signs of the frequency
    wander = 2.0 * WANDER_S / (1.0 + square * WANDER_S**2)
    speeds = SPEED_SIGMA_MPS**2 * step_s + WANDER_MPS**2 * wander
    places = square * 2.0 * PLACE_WANDER_M**2 * PLACE_WANDER_S / (1.0 + square * PLACE_WANDER_S**2)
    both = speeds * places / (speeds + places)
    passed = square * (JERK / (JERK + square**2 * both) * both) ** 2 * width
    return (
        sqrt(float(np.sum(passed / speeds**2)) * step_s),
        sqrt(float(np.sum(passed / speeds**2 * wander))),
        sqrt(float(np.sum(passed / places))),
    )
