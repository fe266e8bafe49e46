"""How a wheel breaks away and is caught again: slip speed over time, as measured slips of trains have it.

Micro-slip grows for a second or two, until adhesion is exceeded; the slip speed then rises steadily, is held by
the control that lets go and grips again (0.6 to 0.9 Hz), falls steadily, and what is left fades out.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import kernel

Floats = NDArray[np.float64]

LEAST_PEAK_MPS: Final = 1.0
MOST_SHARE: Final = 0.8
"""A wheel that slides by more of the train's speed is a locked one."""


@kernel
def lasts_s(row: Floats) -> float:
    """How long it takes from the first micro-slip to the last, of an EpisodeRow."""
    return float(row[12] + row[4] + row[19])


@kernel
def slip_of(since_s: float, onset_mps: float, row: Floats) -> float:
    """Slip speed [m/s], no sign, so long after the beginning of an episode (EpisodeRow) at a train's speed."""
    duration_s, build_up_s, micro_mps, rise, fall = row[4], row[12], row[13], row[14], row[15]
    tail_mps, tail_s = row[18], row[19]
    if since_s < build_up_s:
        return float(micro_mps * since_s / build_up_s)
    away_s, left_s = since_s - build_up_s, build_up_s + duration_s - since_s
    if left_s < 0.0:
        return float(tail_mps * max(1.0 + left_s / max(tail_s, 1e-9), 0.0) ** 2)
    peak = max(row[6] * onset_mps, LEAST_PEAK_MPS)
    # Too short an episode turns before the peak: rise and fall meet where both take `duration_s` together.
    peak = min(peak, (duration_s + micro_mps / rise + tail_mps / fall) / (1.0 / rise + 1.0 / fall))
    peak = max(min(peak, MOST_SHARE * onset_mps), micro_mps, tail_mps)
    rises_s, falls_s = (peak - micro_mps) / rise, (peak - tail_mps) / fall
    held_s = duration_s - rises_s - falls_s
    swings = np.round(held_s * row[17])
    if away_s < rises_s:
        return float(min(micro_mps + rise * away_s, tail_mps + fall * left_s))
    if left_s < falls_s or swings < 1.0:
        return float(min(peak, tail_mps + fall * left_s))
    phase = 2.0 * np.pi * swings * (away_s - rises_s) / held_s
    return float(peak * (1.0 - 0.5 * row[16] * (1.0 - np.cos(phase))))
