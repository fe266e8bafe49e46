"""Where a line passes the same ground more than once: what a bound that spans two passages means, in words."""

from __future__ import annotations

from typing import Final

import numpy as np

from services.gnss_correction.line_estimate import PASSAGE_M
from services.line.axis import Axis
from services.line.projection import candidates

NEAR_M: Final = 30.0
"""Passages nearer than this to each other are not told apart by satellites alone."""


def undecided(axis: Axis, axis_m: float, bound_m: float) -> str:
    """What is not known yet where a bound reaches another passage of the same ground; empty otherwise.

    Passages that run against each other are told apart as soon as the train's direction on the line is
    known, others where they part.
    """
    if not bound_m > PASSAGE_M:
        return ""
    here = np.array([np.interp(axis_m, axis.axis_m, axis.plane_m[:, k]) for k in range(2)])
    others = [foot.axis_m for foot in candidates(axis, here, NEAR_M) if PASSAGE_M < abs(foot.axis_m - axis_m) < bound_m]
    if not others:
        return ""
    tangent = axis.tangent(axis_m)
    against = any(float(tangent @ axis.tangent(other_m)) < 0.0 for other_m in others)
    unknown = "direction" if against else "passage"
    return f"{unknown} not known yet: the line passes here {len(others) + 1} times, the bound covers all of them"
