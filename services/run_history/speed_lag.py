"""By how much a log's speeds come later than its places.

Receivers filter their speeds: a phone's come about 0.6 s after its places, a u-blox receiver's 0.2 s. Then a train
that accelerates seems to run ahead of its speeds: over a window the way by places exceeds the way by speeds by the lag
times what the speed gained. The lag is the slope of the one over the other, from all windows in which the speed
changes. It needs no second receiver and no map, and is zero where the log cannot tell.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
WINDOW_S: Final = 20.0
GAINED_MPS: Final = 3.0
"""Windows in which the speed changes by less say nothing."""
MOST_MISSING_S: Final = 3.0
FEWEST: Final = 20
PRIOR_SIGMA_S: Final = 0.5
"""Of a lag before anything is known: a weak log is left as it is."""
LONGEST_S: Final = 2.0
"""What comes out longer is no lag of a filter: it is left alone."""
LEAST_KNOWN: Final = 0.5
"""Share of fixes with a speed; with fewer of them gaps would be taken for a lag."""
LEAST_SIGMA_M: Final = 0.5
PASSES: Final = 8


def speed_lag_s(t_s: Floats, place_m: Floats, speed_mps: Floats) -> float:
    """Seconds by which speeds are late; NaN in `place_m` or `speed_mps` is what is not known. Shapes (n,)."""
    known = np.flatnonzero(np.isfinite(speed_mps))
    if len(known) < max(FEWEST, LEAST_KNOWN * len(t_s)):
        return 0.0
    t, place, speed = t_s[known], place_m[known], speed_mps[known]
    way = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))))
    late = np.concatenate(([0], np.cumsum(np.diff(t) > MOST_MISSING_S)))
    end = np.minimum(np.searchsorted(t, t + WINDOW_S - 1e-6), len(t) - 1)
    moved, gained = np.abs(place[end] - place) - (way[end] - way), speed[end] - speed
    usable = np.isfinite(moved) & (np.abs(gained) > GAINED_MPS) & (late[end] == late) & (t[end] - t < 1.1 * WINDOW_S)
    moved, gained = moved[usable], gained[usable]
    if len(moved) < FEWEST:
        return 0.0
    lag_s, square, sigma_m = 0.0, 0.0, LEAST_SIGMA_M
    for _ in range(PASSES):
        off = moved - lag_s * gained
        sigma_m = max(1.483 * float(np.median(np.abs(off))), LEAST_SIGMA_M)
        weight = 1.0 / (1.0 + (off / sigma_m) ** 2)
        square = float(np.sum(weight * gained**2))
        lag_s = float(np.sum(weight * gained * moved)) / square
    # Windows overlap: so many of them tell no more than one.
    alike = max(WINDOW_S / float(np.median(np.diff(t))), 1.0)
    variance = sigma_m**2 * alike / square
    share = PRIOR_SIGMA_S**2 / (PRIOR_SIGMA_S**2 + variance)
    return lag_s * share if abs(lag_s) <= LONGEST_S else 0.0
