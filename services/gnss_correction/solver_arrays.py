"""The records between which the solving kernels work (records, because they compile quickly)."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

MOST_SYSTEMS: Final = 7
MOST_UNKNOWNS: Final = 3 + MOST_SYSTEMS

Records = NDArray[np.void]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Float64s = NDArray[np.float64]

_GIVEN: Final = (
    # Earth-fixed satellite position when the signal left, its velocity, its clock times c
    "x_m",
    "y_m",
    "z_m",
    "vx_mps",
    "vy_mps",
    "vz_mps",
    "clock_m",
    "drift_mps",
    "pseudorange_m",
    # from Doppler, positive when the satellite recedes; NaN where there is none
    "range_rate_mps",
    "cn0_dbhz",
    # the same, averaged over the last second or two, for the weights
    "strength_dbhz",
    "carrier_hz",
    # carrier phase times wavelength; NaN where there is none; RINEX loss-of-lock indicator
    "carrier_m",
    "lock_lost",
    # differential correction of the pseudorange, its standard deviation (0 where there is none), its age
    "correction_m",
    "correction_sigma_m",
    "correction_age_s",
)
_FOUND: Final = ("elevation_rad", "azimuth_rad", "residual_m")
_WORK: Final = ("line_x", "line_y", "line_z", "modelled_m", "variance_m2")

ROW: Final = np.dtype(
    [
        *((name, np.int64) for name in ("source", "rank", "satellite", "signal", "system", "ephemeris", "rejection")),
        *((name, np.float64) for name in _GIVEN + _FOUND + _WORK),
    ]
)
"""One satellite at one epoch.

Given: `source` (row of the observations) and `rank` of its signal, `satellite` (code), `signal`
(index), `system` (index of the constellation), `ephemeris` (row of the table, or why none), what
stands in _GIVEN, and in `rejection` why it may not be used so far (see `rejection.Rejection`).
Found: `rejection` completed, direction, and the
residual (measured minus modelled, also of rows that were not used). The rest is working space:
unit vector towards the satellite, pseudorange without the receiver's clock, its variance.
"""

SOLUTION: Final = np.dtype(
    [
        ("outcome", np.int64),
        ("used", np.int64),
        ("needed", np.int64),
        *(
            (name, np.float64)
            for name in (
                "lat_rad",
                "lon_rad",
                "h_m",
                "ve_mps",
                "vn_mps",
                "vu_mps",
                "clock_m",
                "hdop",
                "pdop",
                "sigma_horizontal_m",
                "held_s",
            )
        ),
    ]
)
"""Solution of one epoch, NaN where there is none (see `rejection.Outcome`): place and velocity on WGS 84.

`clock_m` is the receiver clock against the first constellation used, times c; `sigma_horizontal_m`
the root of the sum of both horizontal variances, by the weights and, where larger, the residuals;
`held_s` the age of the height that helped a weak geometry, NaN where none did.
"""

RULES: Final = np.dtype(
    [
        ("by_cn0", np.int64),
        *((name, np.float64) for name in ("elevation_mask_rad", "cn0_mask_dbhz", "most_pdop", "longest_hold_s")),
        ("alpha", np.float64, (4,)),
        ("beta", np.float64, (4,)),
    ]
)
"""How to solve: weights by C/N0 and elevation (1) or by elevation alone (0), limits, Klobuchar coefficients."""


class Workspace(NamedTuple):
    """Working space of one epoch."""

    normal: Float64s
    """Normal matrix and its factor, lower triangle."""
    right: Float64s
    spare: Float64s
    clock_m: Float64s
    """Per constellation; NaN where it is not solved for."""
    column: Ints
    """Unknown that is the clock of each constellation; -1 when it takes no part."""
    held: Float64s
    """A height held as a measurement: its weight (0 when none is), the height, its difference from the present
    place's, and the vertical there (3)."""


def workspace() -> Workspace:
    """Space for the largest possible system."""
    return Workspace(
        np.empty((MOST_UNKNOWNS, MOST_UNKNOWNS)),
        np.empty(MOST_UNKNOWNS),
        np.empty(MOST_UNKNOWNS),
        np.empty(MOST_SYSTEMS),
        np.empty(MOST_SYSTEMS, np.int64),
        np.zeros(6),
    )


def no_solutions(epochs: int) -> Records:
    """Solutions that are none yet."""
    solutions = np.zeros(epochs, SOLUTION)
    for name in SOLUTION.names or ():
        if SOLUTION[name] == np.float64:
            solutions[name] = np.nan
    return solutions
