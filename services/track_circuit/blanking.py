"""Impulses taken out of the samples."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

RATIO: Final = 1.6
"""Threshold over the median of the stretches' peaks: 4.3 sigma of Gaussian noise, and the signal never gets there."""
WINDOW: Final = 301
"""Stretches over which the median runs, about a second of symbols."""
MARGIN: Final = 2
"""Samples blanked to either side of an excess."""


def without_impulses(samples: NDArray[np.float64], stretch: int) -> tuple[NDArray[np.float64], int]:
    """Samples with impulses set to zero, and how many samples were.

    The reference is the median of the peaks of stretches of `stretch` samples (one symbol): impulses in fewer than
    half of the symbols do not move it, and it follows a slowly changing level. Shorter input than three stretches
    comes back as it is.
    """
    count = len(samples) // stretch
    if count < 3:  # noqa: PLR2004 - a median of fewer says nothing
        return samples, 0
    peaks = np.max(np.abs(samples[: count * stretch].reshape(count, stretch)), axis=1)
    reference = np.empty(count)
    for begin in range(0, count, WINDOW // 2):
        near = peaks[max(0, begin - WINDOW // 4) : begin + 3 * WINDOW // 4]
        reference[begin : begin + WINDOW // 2] = np.median(near)
    # Beside silence the louder neighbourhood holds: a signal that begins or ends is no impulse.
    louder = np.lib.stride_tricks.sliding_window_view(np.pad(reference, WINDOW // 2, "edge"), WINDOW - 1)[:count]
    reference = louder.max(axis=1)
    limit = RATIO * np.repeat(reference, stretch)
    limit = np.concatenate([limit, np.full(len(samples) - len(limit), limit[-1])])
    above = (np.abs(samples) > limit) & (limit > 0.0)
    if not above.any():
        return samples, 0
    wide = np.convolve(above, np.ones(2 * MARGIN + 1), mode="same") > 0.0
    return np.where(wide, 0.0, samples), int(np.count_nonzero(wide))
