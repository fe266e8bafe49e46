"""What places say about a departure or an arrival that the speeds alone do not tell.

Below walking pace a phone's speeds are zero, and its filter runs after the train. But the places know how far the train
came from where it stood: further than the first speeds explain, and it left earlier than they say; less far, and
later. Both tell with an error of their own; they are weighed by their variances.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SEEN_S: Final = 4.0
"""Fixes so long after the first speed above V_RAMP."""
STANDING_S: Final = (6.0, 30.0)
"""Fixes of the stop so long before it: the train stands, and its place is the same."""
PLACE_SIGMA_M: Final = 4.0
"""Of the way from standstill to the first fixes: errors of neighbouring places are mostly the same."""
FEWEST: Final = 3


def earlier_s(
    t_s: Floats, place_m: Floats, speed_mps: Floats, first: int, stop: tuple[int, int], slope: float, sigma_s: float
) -> float:
    """By how much a start was earlier than its speeds say; 0 where places do not tell.

    Arrays as for `onset_of`, with places rising; `first`: number of the fix where the rise begins; `stop`: numbers of
    the stop's first fix and of the one past its last; `sigma_s`: how far the ramp alone may be off.
    """
    seen = np.flatnonzero((t_s >= t_s[first]) & (t_s <= t_s[first] + SEEN_S) & np.isfinite(place_m + speed_mps))
    before_s = t_s[first] - t_s[stop[0] : stop[1]]
    stood = place_m[stop[0] : stop[1]][(before_s >= STANDING_S[0]) & (before_s <= STANDING_S[1])]
    stood = stood[np.isfinite(stood)]
    if len(seen) < 2 or len(stood) < FEWEST:  # noqa: PLR2004 - a way needs two
        return 0.0
    t, speed = t_s[seen], speed_mps[seen]
    way = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))))
    ramp_m = speed[0] ** 2 / (2.0 * slope) + speed[0] * (t_s[first] - t[0])
    beyond_m = float(np.median(place_m[seen] - way)) - float(np.median(stood)) - ramp_m
    mean_mps = float(speed.mean())
    variance = (mean_mps * sigma_s) ** 2 + PLACE_SIGMA_M**2
    # Student's t of one degree of freedom, as in the smoother: a place far off is the receiver's, not the train's.
    weight = min(1.0, 2.0 / (1.0 + beyond_m**2 / variance))
    return float(weight * beyond_m * mean_mps * sigma_s**2 / variance)
