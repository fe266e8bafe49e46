"""When a train departed and arrived, from the speeds above walking pace.

Below some km/h satellite speeds say little: phones hold zero for ten seconds after a departure and fall to zero
before an arrival. Maki et al. (section 3.2) go back from V_stop along an assumed acceleration, and on along an
assumed deceleration. Trains start between 0.3 and 1.3 m/s², so the train's own slope above V_RAMP serves better:
a line through the first seconds of credible speeds (Theil 1950, Sen 1968), extended to V_RAMP, and from there a
share of the time the slope would take to zero, with a fixed time for brakes to release and for the last jerk.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.run_history.middle import median_of

Floats = NDArray[np.float64]
V_STOP_MPS: Final = 8.0 / 3.6
V_RAMP_MPS: Final = 5.0 / 3.6
FULL_MPS: Final = 30.0 / 3.6
"""From here the last slow fix is looked for, back towards the stop."""
SLOPES_MPS2: Final = (0.2, 1.5)
HARDEST_MPS2: Final = 2.5
"""A fall harder than this is the receiver's, and ends the fit."""
FEWEST: Final = 3


@dataclass(frozen=True, slots=True)
class Ramp:
    """Time between standstill and V_RAMP: fixed_s + share · V_RAMP / slope; slope fitted over `span_s`."""

    span_s: float
    fixed_s: float
    share: float


# Fitted to 45 legs of Budapest–Füzesabony, phone and u-blox together; see docs/run_history.md.
START: Final = Ramp(span_s=6.0, fixed_s=1.4, share=0.8)
HALT: Final = Ramp(span_s=4.0, fixed_s=1.7, share=0.7)


@dataclass(frozen=True, slots=True)
class Ends:
    """Departure and arrival [s], by the same clock as the fixes (t1, t2, t4, t5 of Maki et al.)."""

    departure_s: float
    """t1."""
    rising_s: float
    """t2: the speed rises through V_stop."""
    falling_s: float
    """t4: it falls through it."""
    arrival_s: float
    """t5."""


@dataclass(frozen=True, slots=True)
class Onset:
    """A start from standstill, or an arrival with its time reversed."""

    still_s: float
    """When the train stood."""
    stop_speed_s: float
    """When it passed V_stop."""
    first: int
    """Number of the first fix of the fit."""
    slope_mps2: float


def onset_of(t_s: Floats, speed_mps: Floats, ramp: Ramp) -> Onset | None:
    """Standstill before a rise of the speed; None where fewer than three speeds tell of it. Times rise; shapes (n,).

    NaN in `speed_mps` is what was not measured. The arrays begin in the stop and go on into the leg.
    """
    known = np.isfinite(speed_mps).nonzero()[0]
    t, v = t_s[known], speed_mps[known]
    full = (v >= FULL_MPS).nonzero()[0]
    last = int(full[0]) if len(full) else len(v)
    slow = (v[:last] < V_RAMP_MPS).nonzero()[0]
    first = int(slow[-1]) + 1 if len(slow) else 0
    past = int(np.searchsorted(t, t[first] + ramp.span_s, side="right")) if first < len(t) else first
    t_fit, v_fit = t[first:past], v[first:past]
    falls = (v_fit[1:] - v_fit[:-1] < -HARDEST_MPS2 * (t_fit[1:] - t_fit[:-1])).nonzero()[0]
    past = first + int(falls[0]) + 1 if len(falls) else past
    if past - first < FEWEST:
        return None
    t, v = t[first:past], v[first:past]
    apart_s, risen = t[None, :] - t[:, None], v[None, :] - v[:, None]
    pairs = apart_s >= 0.9 * min(1.0, float(t[-1] - t[0]))  # closer pairs tell of noise alone
    slope = min(max(median_of(risen[pairs] / apart_s[pairs]), SLOPES_MPS2[0]), SLOPES_MPS2[1])
    zero_s = median_of(t - v / slope)
    still_s = zero_s + V_RAMP_MPS / slope * (1.0 - ramp.share) - ramp.fixed_s
    return Onset(still_s, zero_s + V_STOP_MPS / slope, int(known[first]), slope)


def crossing_s(t_s: Floats, speed_mps: Floats, before: int, after: int) -> float:
    """When the speed passes V_stop between two fixes."""
    low, high = float(speed_mps[before]), float(speed_mps[after])
    share = 0.5 if high == low else (V_STOP_MPS - low) / (high - low)
    return float(t_s[before] + min(max(share, 0.0), 1.0) * (t_s[after] - t_s[before]))
