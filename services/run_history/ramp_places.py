"""What places say about a departure or an arrival that the speeds alone do not tell.

Below walking pace a phone's speeds are zero, and its filter runs after the train. But the places know how far the train
came from where it stood: further than the first speeds explain, and it left earlier than they say; less far, and
later. Both tell with an error of their own; they are weighed by their variances.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.run_history.middle import median_of

Floats = NDArray[np.float64]
SEEN_S: Final = 4.0
"""Fixes so long after the first speed above V_RAMP."""
STANDING_S: Final = (6.0, 30.0)
"""Fixes of the stop so long before it: the train stands, and its place is the same."""
PLACE_SIGMA_M: Final = 4.0
"""Of the way from standstill to the first fixes: errors of neighbouring places are mostly the same."""
FEWEST: Final = 3


def earlier_s(
    t_s: Floats, place_m: Floats, speed_mps: Floats, first: int, stop_fixes: int, slope: float, sigma_s: float
) -> float:
    """By how much a start was earlier than its speeds say; 0 where places do not tell.

    Arrays as for `onset_of`, with places rising; `first`: number of the fix where the rise begins; the
    first `stop_fixes` are of the stop; `sigma_s`: how far the ramp alone may be off.
    """
    past = int(np.searchsorted(t_s, t_s[first] + SEEN_S, side="right"))
    seen = first + np.isfinite(place_m[first:past] + speed_mps[first:past]).nonzero()[0]
    before_s = t_s[first] - t_s[:stop_fixes]
    stood = place_m[:stop_fixes][(before_s >= STANDING_S[0]) & (before_s <= STANDING_S[1])]
    stood = stood[np.isfinite(stood)]
    if len(seen) < 2 or len(stood) < FEWEST:  # noqa: PLR2004 - a way needs two
        return 0.0
    t, speed = t_s[seen], speed_mps[seen]
    way = np.zeros(len(t))
    np.cumsum(0.5 * (speed[1:] + speed[:-1]) * (t[1:] - t[:-1]), out=way[1:])
    ramp_m = speed[0] ** 2 / (2.0 * slope) + speed[0] * (t_s[first] - t[0])
    beyond_m = median_of(place_m[seen] - way) - median_of(stood) - ramp_m
    mean_mps = float(speed.sum()) / len(speed)
    variance = (mean_mps * sigma_s) ** 2 + PLACE_SIGMA_M**2
    # Student's t of one degree of freedom, as in the smoother: a place far off is the receiver's, not the train's.
    weight = min(1.0, 2.0 / (1.0 + beyond_m**2 / variance))
    return float(weight * beyond_m * mean_mps * sigma_s**2 / variance)
