"""What the robust filter remembers between epochs, and the rules by which it works.

State (14): position [m] and velocity [m/s], Earth-fixed; clock drift [m/s]; one receiver clock per
constellation [m], in the order of `SYSTEMS`.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from services.gnss_correction.ephemeris_table import CODES
from services.gnss_correction.solver_arrays import MOST_SYSTEMS, Float64s, Ints

VELOCITY: Final = 3
DRIFT: Final = 6
CLOCK: Final = 7
SIZE: Final = CLOCK + MOST_SYSTEMS
"""Unknowns, and the first one of velocity, drift and clocks."""

FILTER_RULES: Final = np.dtype([
    (name, np.float64)
    for name in (
        "acceleration_mps2",
        "climb_mps2",
        "degrees_of_freedom",
        "correlation_s",
        "code_floor_m",
        "code_scale",
        "slow_share",
        "clock_noise_m",
        "isb_noise_m",
        "glonass_m",
        "doppler_scale",
        "half_db",
        "skew",
    )
])  # fmt: skip


class Memory(NamedTuple):
    """State of the filter; arrays, so that kernels change them in place."""

    state: Float64s
    """Shape (SIZE,)."""
    covariance: Float64s
    """Shape (SIZE, SIZE), symmetric."""
    started: Float64s
    """Shape (1,): 1 once there is a state."""
    t_s: Float64s
    clock_known: Ints
    response: Float64s
    """Shape (CODES, SIZE): what an error of one metre, constant so far, in a satellite's pseudoranges does to the
    state."""
    responding: Ints
    suspicion: Float64s
    scale: Float64s


def no_memory() -> Memory:
    """Nothing is known."""
    return Memory(
        np.zeros(SIZE),
        np.zeros((SIZE, SIZE)),
        np.zeros(1),
        np.zeros(1),
        np.zeros(MOST_SYSTEMS, np.int64),
        np.zeros((CODES, SIZE)),
        np.zeros(CODES, np.int64),
        np.zeros((CODES, 2)),
        np.ones(4),
    )
