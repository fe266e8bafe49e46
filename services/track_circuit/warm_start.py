"""Stored coefficients put to use: aligned in time, phase and gain by two pilot bits, then adapted with a lead.

Arai et al., section 3.2, propose coefficients from trial runs as the start; alone they fail, because carrier phase,
level and timing are others on the day.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.least_squares import windows

ALIGN_SYMBOLS = 2
"""Pilot bits used."""
SHIFTS = 2
"""Half chips to either side over which the stored taps are tried."""
STEP = 0.05
"""NLMS step from a warm start."""
LEAK = 0.02
"""Share by which the taps return to the stored ones at every burst."""
CLAMP = 0.5
"""Greatest distance from the stored taps, relative to their size."""


def aligned(
    stored: NDArray[np.complex128], inputs: NDArray[np.complex128], target: NDArray[np.complex128], stride: int
) -> NDArray[np.complex128]:
    """Stored taps, moved and with one complex gain, such that they give `target` best in the mean square.

    `inputs` must reach SHIFTS beyond what the targets need at the end. The gain has no limit: between dry and wet
    ballast a level moves by more than 20 dB.
    """
    best, least = stored, np.inf
    energy = float(np.sum(np.abs(target) ** 2))
    for shift in range(-SHIFTS, SHIFTS + 1):
        taps = np.zeros_like(stored)
        taps[max(shift, 0) : len(stored) + min(shift, 0)] = stored[max(-shift, 0) : len(stored) - max(shift, 0)]
        output = windows(inputs, len(target), len(taps), stride) @ taps
        power = float(np.sum(np.abs(output) ** 2)) + 1e-30
        gain = np.vdot(output, target) / power
        left = energy - float(abs(gain)) ** 2 * power
        # Without a shift nothing is lost at the ends: another place must be better by more than chance.
        if left < least * (1.0 if shift == 0 else 0.8) or (shift == 0 and left < least * 1.25):
            best, least = taps * gain, left
    return np.asarray(best, np.complex128)


def held(taps: NDArray[np.complex128], anchor: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Adapted taps, leaked towards the anchor (the aligned stored taps) and clamped to its neighbourhood."""
    distance = (taps - anchor) * (1.0 - LEAK)
    size, limit = float(np.linalg.norm(distance)), CLAMP * float(np.linalg.norm(anchor))
    if size > limit:
        distance = distance * (limit / size)
    return np.asarray(anchor + distance, np.complex128)
