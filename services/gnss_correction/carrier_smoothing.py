"""Pseudoranges smoothed by the carrier phase (Hatch 1982).

P'(k) = w P(k) + (1 - w) (P'(k-1) + L(k) - L(k-1)),  w = max(dt / T, 1 / n)

P pseudorange, L carrier phase times wavelength, n measurements since the last cycle slip, T the
time constant, which bounds what the ionosphere does to code and carrier in opposite senses. A slip
begins anew. It is noticed by the receiver's loss-of-lock indicator, by a carrier that leaves its
Doppler, and by a pseudorange that leaves the smoothed one by more than code noise and multipath can.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from services.gnss_correction.ephemeris_table import CODES
from services.gnss_correction.rejection import Rejection
from services.gnss_correction.solver_arrays import Float64s, Ints, Records
from services.numerics.kernel import kernel

SLIP_M: Final = 0.5
"""Carrier against Doppler: a slip of three L1 cycles; vehicles that change their acceleration stay below over 1 s."""
DIVERGENCE_M: Final = 15.0
"""Pseudorange against the smoothed one: more than code noise and short reflections of a tracked carrier."""
LONGEST_GAP_S: Final = 1.5
"""After a longer gap nobody knows how many cycles went by; receivers of 1 Hz stay below."""

_T, _SIGNAL, _SMOOTHED, _CARRIER, _RATE, _COUNT = range(6)
_KNOWN: Final = 6
_REFUSED, _MISSING = int(Rejection.EPOCH_REFUSED), int(Rejection.NO_PSEUDORANGE)


@kernel
def smoothed_m(previous_m: float, advance_m: float, pseudorange_m: float, weight: float) -> float:
    """Smoothed pseudorange from the previous one, the carrier's advance and the new pseudorange with its weight.

    >>> float(smoothed_m(100.0, 5.0, 107.0, 0.25))
    105.5
    """
    return weight * pseudorange_m + (1.0 - weight) * (previous_m + advance_m)


@kernel
def _follows(row: Any, age_s: float, past: Float64s) -> bool:  # noqa: ANN401 - numba record
    """Whether a row's carrier goes on from the one before without a slip."""
    if not 0.0 < age_s <= LONGEST_GAP_S or past[_SIGNAL] != row.signal or int(row.lock_lost) % 2 == 1:
        return False
    advance_m = row.carrier_m - past[_CARRIER]
    if not np.isfinite(advance_m):
        return False
    by_doppler_m = 0.5 * (row.range_rate_mps + past[_RATE]) * age_s
    if np.isfinite(by_doppler_m) and abs(advance_m - by_doppler_m) > SLIP_M:
        return False
    return bool(abs(row.pseudorange_m - past[_SMOOTHED] - advance_m) <= DIVERGENCE_M)


@kernel
def _smooth(first_row: Ints, t_s: Float64s, rows: Records, smooth_s: float, known: Float64s) -> None:
    for epoch in range(t_s.size):
        for row in rows[first_row[epoch] : first_row[epoch + 1]]:
            if row.rejection in (_REFUSED, _MISSING):
                continue
            past = known[row.satellite]
            age_s = t_s[epoch] - past[_T]
            if _follows(row, age_s, past):
                past[_COUNT] += 1.0
                weight = max(min(age_s / smooth_s, 1.0), 1.0 / past[_COUNT])
                row.pseudorange_m = smoothed_m(
                    past[_SMOOTHED], row.carrier_m - past[_CARRIER], row.pseudorange_m, weight
                )
            else:
                past[_COUNT] = 1.0
            past[_T], past[_SIGNAL], past[_SMOOTHED] = t_s[epoch], row.signal, row.pseudorange_m
            past[_CARRIER], past[_RATE] = row.carrier_m, row.range_rate_mps


class CarrierSmoother:
    """Smooths the pseudoranges of one receiver; the division into blocks changes nothing."""

    def __init__(self, smooth_s: float) -> None:
        """Know no satellite; `smooth_s` is the time constant T, above 0."""
        self._smooth_s = smooth_s
        self._known = np.full((CODES, _KNOWN), np.nan)

    def smooth(self, first_row: Ints, t_s: Float64s, rows: Records) -> None:
        """Put smoothed pseudoranges into `rows` (dtype ROW); those without a carrier stay as they are."""
        _smooth(first_row, t_s, rows, self._smooth_s, self._known)
