"""How fast corrections change, from the station's carrier phases.

The difference of two epochs of (modelled range - carrier) is the change of the correction and of the
station's clock. The clock is the median of a constellation; what is left is averaged over RATE_S,
because a correction is carried forward by its rate.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.gnss_correction.carrier_smoothing import LONGEST_GAP_S
from services.gnss_correction.ephemeris_table import CODES
from services.gnss_correction.solver_arrays import Float64s, Ints, Records

RATE_S: Final = 60.0
"""Time constant of the averaged rates: the air above a station changes over minutes."""
SETTLED_S: Final = 10.0
"""A rate of fewer seconds is noise still: none is given."""
FASTEST_MPS: Final = 0.5
"""A carrier that leaves the others' faster has slipped, or its satellite drifts: its rate begins anew."""


class CorrectionRates:
    """Follows the carrier of every satellite at one station."""

    def __init__(self) -> None:
        """Know nothing yet."""
        self._t_s = np.full(CODES, np.nan)
        self._excess_m = np.full(CODES, np.nan)
        self._ephemeris = np.full(CODES, np.nan)
        self._since_s = np.full(CODES, np.nan)
        self._rate_mps = np.zeros(CODES)

    def take(self, t_s: float, rows: Records, issued: Float64s) -> Float64s:
        """Rates [m/s] of rows (dtype ROW, one per satellite, seen from the station) at `t_s`; 0 where none is known.

        `issued` tells ephemerides apart: a new one shifts the modelled range.
        """
        codes: Ints = rows["satellite"].astype(np.int64)
        excess_m = rows["modelled_m"] - rows["carrier_m"]
        age_s = t_s - self._t_s[codes]
        follows = (age_s > 0.0) & (age_s <= LONGEST_GAP_S) & (rows["lock_lost"].astype(np.int64) % 2 == 0)
        follows &= (self._ephemeris[codes] == issued) & np.isfinite(excess_m - self._excess_m[codes])
        sample_mps = np.zeros(codes.size)
        sample_mps[follows] = (excess_m - self._excess_m[codes])[follows] / age_s[follows]
        for system in np.unique(rows["system"][follows]):
            own = follows & (rows["system"] == system)
            sample_mps[own] -= np.median(sample_mps[own])
        follows &= np.abs(sample_mps) < FASTEST_MPS
        self._average(codes, t_s, age_s, sample_mps, follows)
        self._t_s[codes], self._excess_m[codes], self._ephemeris[codes] = t_s, excess_m, issued
        settled = t_s - self._since_s[codes] >= SETTLED_S
        return np.where(settled, self._rate_mps[codes], 0.0)

    def _average(
        self, codes: Ints, t_s: float, age_s: Float64s, sample_mps: Float64s, follows: NDArray[np.bool_]
    ) -> None:
        begun, going = codes[~follows], codes[follows]
        self._since_s[begun], self._rate_mps[begun] = t_s, 0.0
        span_s = np.minimum(t_s - self._since_s[going], RATE_S)
        self._rate_mps[going] += age_s[follows] / span_s * (sample_mps[follows] - self._rate_mps[going])
