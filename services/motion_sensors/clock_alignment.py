"""Clocks that know nothing of each other, brought together by what both have recorded of the same motion."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

STEP_S: Final = 0.01
LEAST_LIKENESS: Final = 0.8
"""Correlation below which two recordings are not of the same motion."""


class Alignment(NamedTuple):
    """What must be added to the second clock, and how alike the two recordings then are (correlation)."""

    offset_s: float
    likeness: float


def running_mean(values: Floats, samples: int) -> Floats:
    """Centred mean over so many samples, shorter at the ends; shape as `values`."""
    width = np.ones(max(1, samples))
    total: Floats = np.convolve(values, width, "same") / np.convolve(np.ones(len(values)), width, "same")
    return total


def align(first_s: Floats, first: Floats, second_s: Floats, second: Floats) -> Alignment:
    """Offset of the second clock by which `second` is most like `first`, to 0.01 s (cross-correlation).

    Both are freed of their mean; beyond its ends each counts as its mean.
    """
    grid_s = np.arange(first_s[0], first_s[-1], STEP_S)
    other_s = np.arange(second_s[0], second_s[-1], STEP_S)
    one, two = np.interp(grid_s, first_s, first), np.interp(other_s, second_s, second)
    one, two = one - one.mean(), two - two.mean()
    size = 2 * (len(one) + len(two))
    products = np.fft.irfft(np.fft.rfft(one, size) * np.conj(np.fft.rfft(two, size)), size)
    best = int(np.argmax(products))
    norm = float(np.sqrt((one @ one) * (two @ two)))
    lag = best if best < size // 2 else best - size
    likeness = float(products[best]) / norm if norm > 0.0 else 0.0
    return Alignment(float(grid_s[0] - other_s[0] + lag * STEP_S), likeness)
