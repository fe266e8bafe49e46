"""The shortest time any train could take for a leg: what is faster did not happen."""

from __future__ import annotations

from typing import Final

import numpy as np

from services.line.alignment import Alignment

STEP_M: Final = 25.0
HARDEST_MPS2: Final = 1.5
"""No train starts or brakes harder in service."""
OVER_LIMIT: Final = 1.1
"""Limits in line files are sometimes older than the track."""
STOPS_ASIDE_M: Final = 100.0
"""Trains stop before and behind the places of stations: a leg is shorter by so much at most."""


def least_time_s(way: Alignment, start_m: float, end_m: float, fastest_mps: float) -> float:
    """Time from standstill to standstill between two places on the axis, at the limits and the vehicle's top speed.

    Speeds are the highest under v² ≤ limit², rising and falling by no more than HARDEST_MPS2.
    """
    length = max(abs(end_m - start_m) - STOPS_ASIDE_M, STEP_M)
    place = np.linspace(0.0, length, int(length / STEP_M) + 2)
    limit = way.speed_limit_mps(min(start_m, end_m) + STOPS_ASIDE_M / 2.0 + place)
    square = np.minimum(OVER_LIMIT * limit, fastest_mps) ** 2
    square[[0, -1]] = 0.0
    ramp = 2.0 * HARDEST_MPS2 * place
    square = np.minimum.accumulate(square - ramp) + ramp
    square = np.minimum.accumulate((square + ramp)[::-1])[::-1] - ramp
    speed = np.sqrt(np.maximum(square, 0.0))
    # Over a step of even acceleration the mean speed is the mean of both ends.
    return float(np.sum(np.diff(place) / (0.5 * (speed[1:] + speed[:-1]))))
