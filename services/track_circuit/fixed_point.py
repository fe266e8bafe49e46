"""The MLSE receiver's decision path in 16-bit integers, for signal processors.

Samples, channel waveform and pilot replica are Q15; products accumulate in 40 bits and are rounded to Q15 with
saturation; the search over two states adds in 32 bits. What is estimated (the response) stays in floating point: it is
computed once per burst, off the sample path. Every integer is exact: the same words on every machine.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import inner_kernel, kernel

ONE: Final = 1 << 15
"""1.0 in Q15; the largest word is ONE - 1."""
HEADROOM: Final = 4.0
"""Samples are scaled so that their root mean square is full scale over this: noise peaks saturate once in 10^4."""


def quantised(values: NDArray[np.float64], scale: float) -> NDArray[np.int64]:
    """Q15 words of values times `scale`, rounded to nearest and saturated."""
    words = np.rint(values * (scale * ONE))
    return np.clip(words, -ONE, ONE - 1).astype(np.int64)


@inner_kernel
def saturated(value: int, bits: int) -> int:
    """The value within a signed word of `bits` bits."""
    top = (1 << (bits - 1)) - 1
    return min(max(value, -top - 1), top)


@kernel
def matched_q15(
    samples: NDArray[np.int64], waveform: NDArray[np.int64], step: int, count: int, shift: int
) -> NDArray[np.int64]:
    """Re sum conj(g) r per symbol: rows of `samples`, `waveform` are real and imaginary words.

    The sum saturates at 40 bits after every product and is rounded by `shift` bits to a word of 16.
    """
    found = np.zeros(count, np.int64)
    for m in range(count):
        total = 0
        for n in range(waveform.shape[1]):
            at = m * step + n
            if at < samples.shape[1]:
                product = waveform[0, n] * samples[0, at] + waveform[1, n] * samples[1, at]
                total = saturated(total + product, 40)
        found[m] = saturated((total + (1 << (shift - 1))) >> shift, 16)
    return found


@kernel
def sequence_q15(matched: NDArray[np.int64], overlap: int) -> NDArray[np.int64]:
    """Decisions +1 or -1 of the Viterbi search over two states with 32-bit metrics.

    `overlap` is Re rho_1 in the scale of `matched`; the greater metric is taken off both at every step.
    """
    count = len(matched)
    before = np.zeros((count, 2), np.int64)
    metric_plus, metric_minus = 0, 0
    for m in range(count):
        if m == 0:
            metric_plus, metric_minus = matched[0], -matched[0]
            continue
        stay, change = metric_plus - overlap, metric_minus + overlap
        before[m, 0] = 0 if stay >= change else 1
        plus = saturated(max(stay, change) + matched[m], 32)
        stay, change = metric_minus - overlap, metric_plus + overlap
        before[m, 1] = 1 if stay >= change else 0
        minus = saturated(max(stay, change) - matched[m], 32)
        greatest = max(plus, minus)
        metric_plus, metric_minus = plus - greatest, minus - greatest
    found = np.empty(count, np.int64)
    state = 0 if metric_plus >= metric_minus else 1
    for m in range(count - 1, -1, -1):
        found[m] = 1 - 2 * state
        state = before[m, state]
    return found


def decide_q15(
    samples: NDArray[np.complex128],
    pilot: NDArray[np.complex128],
    waveform: NDArray[np.complex128],
    step: int,
    count: int,
) -> NDArray[np.int64]:
    """CH1's symbols, +1 or -1, of a burst: pilot replica subtracted, matched, searched, all in integers.

    `samples` and `pilot` begin where the first symbol's waveform does; `step` is a symbol in samples. The waveform is
    scaled to full use of its words, its energy divided out by the shift behind the accumulator.
    """
    scale = 1.0 / (HEADROOM * float(np.sqrt(np.mean(np.abs(samples) ** 2) / 2.0)) + 1e-30)
    words = np.stack([quantised(samples.real, scale), quantised(samples.imag, scale)])
    replica = np.stack([quantised(pilot.real, scale), quantised(pilot.imag, scale)])
    length = min(words.shape[1], replica.shape[1])
    residual = np.clip(words[:, :length] - replica[:, :length], -ONE, ONE - 1)
    peak = float(np.max(np.abs(np.concatenate([waveform.real, waveform.imag])))) + 1e-30
    gain = (ONE - 1) / (ONE * peak)
    shape = np.stack([quantised(waveform.real, gain), quantised(waveform.imag, gain)])
    energy = float(np.sum(np.abs(waveform) ** 2))
    # A perfect symbol comes out of the accumulator as energy x scale x gain; the shift brings it near a quarter.
    perfect = energy * scale * gain * float(ONE) * float(ONE)
    shift = max(1, round(float(np.log2(perfect / (ONE / 4.0)))))
    overlap = float(np.vdot(waveform[step:], waveform[:-step]).real) / energy * perfect / 2.0**shift
    return sequence_q15(matched_q15(residual, shape, step, count, shift), round(overlap))
