"""Whether the train is on the line at all: do the satellites agree there, and would they agree better beside it.

At the believed place, and at some distances to both sides of it, receiver clocks are fitted to the
pseudoranges of the epoch alone, and their disagreement is taken (0: all agree, 1: none does). Reflections
make satellites disagree everywhere; a train beside the line makes them agree elsewhere.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from services.gnss_correction.line_likelihood import level_of, weigh_cells
from services.gnss_correction.line_windows import even
from services.gnss_correction.solver_arrays import Float64s, Records
from services.numerics.kernel import kernel

_STEPS_M: Final = (30.0, 60.0, 90.0, 120.0, 160.0, 200.0, 250.0, 320.0)
ASIDE_M: Final = np.array([0.0, *_STEPS_M, *(-step for step in _STEPS_M)])
"""Where to look: the line itself, then to the right and to the left of it."""
LOOK_AGAIN_S: Final = 1.0
AVERAGING_S: Final = 10.0
CLEARLY_BETTER: Final = 0.2
"""By so much less disagreement beside the line, the train is beside it."""
HOPELESS: Final = 0.68
"""So much disagreement with the place and the clocks followed so far, and the train is elsewhere: even deep among
buildings half the satellites agree on the truth."""
FAR_M: Final = 80.0
"""Free fixes that stay further from the line than reflections take them,"""
AWAY_M: Final = 60.0
FREELY_BETTER: Final = 0.3
"""A free fix that stays this far from the line, with so much less disagreement, tells so too."""
SUSPICIOUS: Final = 0.4
"""while satellites also disagree this much, tells the same."""
RELIEF: Final = 0.8
"""Once denied, the limits are this share of themselves."""
_NO_WHEEL: Final = np.array([np.nan, np.nan])


@kernel
def _levels(points: Float64s, tangents: Float64s, states: Float64s, sights: Records, levels: Float64s) -> None:
    """Disagreement at each point with the states fitted there."""
    for i in range(points.shape[0]):
        levels[i] = level_of(points[i], tangents[i], states[i], sights)


def _levels_around(point: Float64s, tangent: Float64s, free: Float64s, sights: Records) -> Float64s:
    """Disagreement at each of ASIDE_M from a place and at the free fix, with clocks fitted there."""
    left = np.cross(point / np.linalg.norm(point), tangent)
    other = free if np.isfinite(free).all() else point
    points = np.vstack([point + ASIDE_M[:, None] * left, other])
    tangents = np.tile(tangent, (len(points), 1))
    states = even(0.0, len(points)).states
    weigh_cells(points, tangents, states, sights, 1.0, 0.0, _NO_WHEEL, np.zeros(len(points)))
    levels = np.empty(len(points))
    _levels(points, tangents, states, sights, levels)
    return levels


class Belonging:
    """Averages the disagreement on and beside the line, and the distance of free fixes from it."""

    def __init__(self) -> None:
        """Know nothing yet."""
        self._levels = np.zeros(len(ASIDE_M) + 1)
        self._followed = 0.0
        self._away_m = 0.0
        self._known_s = 0.0
        self._looked_s = math.inf
        self._denied = False

    def take(
        self,
        point: Float64s,
        tangent: Float64s,
        sights: Records,
        followed: float,
        free: Float64s,
        away_m: float,
        dt_s: float,
    ) -> None:
        """Take in an epoch at the believed place (3,), Earth-fixed like the tangent there.

        `followed` is the disagreement with the clocks followed so far, `free` (3,) the fix that knows
        nothing of the line and `away_m` its distance from the line, NaN where there is none.
        """
        self._known_s = min(self._known_s + max(dt_s, 0.1), AVERAGING_S)
        gain = min(1.0, max(dt_s, 0.1) / self._known_s)
        self._followed += (followed - self._followed) * gain
        if math.isfinite(away_m):
            self._away_m += (away_m - self._away_m) * gain
        self._looked_s += dt_s
        if self._looked_s >= LOOK_AGAIN_S:
            self._levels += (_levels_around(point, tangent, free, sights) - self._levels) * min(
                1.0, min(self._looked_s, AVERAGING_S) / self._known_s
            )
            self._looked_s = 0.0

    def denial(self) -> str:
        """Why the train is not on the line; empty when it may well be."""
        reason = self._reason(RELIEF if self._denied else 1.0)
        self._denied = bool(reason)
        return reason

    def _reason(self, relief: float) -> str:
        here, beside = float(self._levels[0]), int(np.argmin(self._levels[:-1]))
        if here - float(self._levels[beside]) > CLEARLY_BETTER * relief:
            side = "left" if ASIDE_M[beside] > 0.0 else "right"
            return f"not on the line: the satellites agree about {math.fabs(ASIDE_M[beside]):.0f} m {side} of it"
        if self._away_m > AWAY_M * relief and here - float(self._levels[-1]) > FREELY_BETTER * relief:
            return f"not on the line: the satellites agree {self._away_m:.0f} m away from it"
        if self._followed > HOPELESS * relief:
            return f"not on the line: {100.0 * self._followed:.0f} % disagreement of the satellites at its best place"
        if self._away_m > FAR_M * relief and self._followed > SUSPICIOUS * relief:
            return f"not on the line: free fixes are {self._away_m:.0f} m away from it"
        return ""
