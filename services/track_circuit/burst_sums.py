"""The two sums over a burst that take a receiver most time: normal equations of the channel, and matched filter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import summing_kernel


@summing_kernel
def add_normal_equations(
    chips: NDArray[np.float64],
    samples: NDArray[np.complex128],
    begin: int,
    matrix: NDArray[np.float64],
    right: NDArray[np.complex128],
) -> float:
    """Add sum s_k s_k^T to `matrix` and sum s_k z_k to `right`, and give sum |z_k|^2.

    s_k = (s[k], s[k-1] … s[k-taps+1]) are chips, z_k the pair of samples 2 (begin + k - taps + 1) and the next, for
    every k whose chips are all given. Neighbours on a diagonal of the matrix differ by the first and the last product.
    """
    taps = matrix.shape[0]
    last = len(chips) - 1
    for lag in range(taps):
        total = 0.0
        for k in range(taps - 1, last + 1):
            total += chips[k] * chips[k - lag]
        matrix[0, lag] += total
        if lag:
            matrix[lag, 0] += total
        for i in range(1, taps - lag):
            total += chips[taps - 1 - i] * chips[taps - 1 - i - lag] - chips[last + 1 - i] * chips[last + 1 - i - lag]
            matrix[i, i + lag] += total
            if lag:
                matrix[i + lag, i] += total
    count = last + 2 - taps
    split = np.empty((4, count))
    energy = 0.0
    for k in range(count):
        early, late = samples[2 * (begin + k)], samples[2 * (begin + k) + 1]
        split[0, k], split[1, k], split[2, k], split[3, k] = early.real, early.imag, late.real, late.imag
        energy += early.real**2 + early.imag**2 + late.real**2 + late.imag**2
    for j in range(taps):
        a, b, c, d = 0.0, 0.0, 0.0, 0.0
        for k in range(count):
            chip = chips[k + taps - 1 - j]
            a += chip * split[0, k]
            b += chip * split[1, k]
            c += chip * split[2, k]
            d += chip * split[3, k]
        right[j, 0] += a + 1j * b
        right[j, 1] += c + 1j * d
    return energy


@summing_kernel
def matched_without_pilot(
    samples: NDArray[np.complex128],
    pilot_chips: NDArray[np.float64],
    taps: NDArray[np.complex128],
    waveform: NDArray[np.complex128],
    step: int,
    found: NDArray[np.complex128],
) -> None:
    """found[m] = sum over n of conj(waveform[n]) (samples - pilot)[m step + n] / sum |waveform|^2.

    The pilot is what `pilot_chips` cause behind the response `taps`, shape (2, taps); beyond the samples is silence.
    """
    length = min(len(samples), step * (len(found) - 1) + len(waveform), 2 * (len(pilot_chips) + taps.shape[1] - 1))
    pairs = (length + 1) // 2
    rest = np.zeros((4, pairs + taps.shape[1]))
    for k in range(pairs):
        rest[0, k], rest[1, k] = samples[2 * k].real, samples[2 * k].imag
        if 2 * k + 1 < length:
            rest[2, k], rest[3, k] = samples[2 * k + 1].real, samples[2 * k + 1].imag
    for j in range(taps.shape[1]):
        a, b, c, d = taps[0, j].real, taps[0, j].imag, taps[1, j].real, taps[1, j].imag
        for k in range(min(len(pilot_chips), pairs - j)):
            chip = pilot_chips[k]
            rest[0, k + j] -= a * chip
            rest[1, k + j] -= b * chip
            rest[2, k + j] -= c * chip
            rest[3, k + j] -= d * chip
    energy = 1e-30
    for n in range(len(waveform)):
        energy += waveform[n].real ** 2 + waveform[n].imag ** 2
    for m in range(len(found)):
        real, imaginary = 0.0, 0.0
        for n in range(min(len(waveform), length - m * step)):
            at, half = (m * step + n) // 2, 2 * ((m * step + n) % 2)
            x, y = rest[half, at], rest[half + 1, at]
            real += waveform[n].real * x + waveform[n].imag * y
            imaginary += waveform[n].real * y - waveform[n].imag * x
        found[m] = (real + 1j * imaginary) / energy
