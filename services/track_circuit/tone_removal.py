"""Foreign tones in bursts, their amplitudes and phases fitted together by least squares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

RIDGE = 1e-6
"""Added to the normal matrix relative to its diagonal, for tones that nearly coincide."""
MOST_CURVED = 12
"""Tones up to which each may change within a burst: three dimensions apiece."""
CURVED_RIDGE = 1e-5
"""RIDGE for these: neighbours that change overlap more."""
STEP = 64
"""Samples per coarse step: a phasor is the product of a coarse and a fine one, which saves most exponentials."""


def phasors(tones: NDArray[np.float64], count: int) -> NDArray[np.complex64]:
    """exp(2 pi j f n) for n = 0 … count - 1 and on to the next multiple of STEP, one row per tone f.

    In single precision: what is taken out is right to -130 dB, and half as much memory passes by.
    """
    coarse = np.exp(2j * np.pi * np.outer(tones, np.arange(0, count, STEP))).astype(np.complex64)
    fine = np.exp(2j * np.pi * np.outer(tones, np.arange(STEP))).astype(np.complex64)
    return np.asarray((coarse[:, :, None] * fine[:, None, :]).reshape(len(tones), -1), np.complex64)


def overlaps(tones: NDArray[np.float64], count: int) -> NDArray[np.complex128]:
    """Inner products of the first `count` values of the phasors, as geometric sums: (z^count - 1) / (z - 1)."""
    turn, turns = np.exp(2j * np.pi * tones), np.exp(2j * np.pi * tones * count)
    below = np.conj(turn)[:, None] * turn - 1.0
    same = np.abs(below) < 1e-12  # noqa: PLR2004 - where the quotient is its limit
    above = np.conj(turns)[:, None] * turns - 1.0
    return np.where(same, complex(count), above / np.where(same, 1.0, below))


class ToneRemoval:
    """One set of tones and one length of bursts; what depends on these alone is worked out once.

    A few tones may change within a burst: amplitude and phase are polynomials of time then, which follows some 30 Hz/s.
    """

    def __init__(self, tones: NDArray[np.float64], count: int) -> None:
        """For bursts of `count` samples; `tones` in cycles per sample."""
        self.tones, self.count = tones, count
        waves = phasors(tones, count)
        if len(tones) <= MOST_CURVED:
            time = np.linspace(-1.0, 1.0, count, dtype=np.float32)
            curves = (np.ones(count, np.float32), time, 1.5 * time**2 - 0.5)
            waves = np.concatenate([waves[:, :count] * curve for curve in curves])
            inner = (np.conj(waves) @ waves.T).astype(np.complex128)
            weight = CURVED_RIDGE * count
        else:
            inner, weight = overlaps(tones, count), RIDGE * count
        self._waves = np.ascontiguousarray(waves)
        unit = np.eye(len(inner), dtype=np.complex128)
        # Bursts come by the hundred: for so few tones, so far apart, the inverse is as exact as solving every time.
        self._inverse = np.linalg.solve(inner + weight * unit, unit)

    def tones_in(self, samples: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """The tones as they stand in the samples of a burst."""
        padded = np.zeros(self._waves.shape[1], np.complex64)
        padded[: self.count] = np.conj(samples)
        heard = np.conj(self._waves @ padded)
        amplitudes = (self._inverse @ heard).astype(np.complex64)
        return np.asarray((amplitudes @ self._waves)[: self.count], np.complex128)
