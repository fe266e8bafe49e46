from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from services.track_circuit.fixed_point import ONE, decide_q15, quantised, sequence_q15
from services.track_circuit.mlse import matched_outputs, sequence_soft


@pytest.mark.parametrize("overlap", [0.0, 0.3, -0.45])
def test_the_search_finds_the_most_likely_of_all_sequences(overlap: float) -> None:
    generator = np.random.default_rng(4)
    for _ in range(20):
        matched = generator.normal(size=9)
        every = np.array(list(product([1.0, -1.0], repeat=9)))
        metric = 2.0 * every @ matched - 2.0 * overlap * np.sum(every[:, 1:] * every[:, :-1], axis=1)
        soft = sequence_soft(matched, overlap)
        assert np.array_equal(np.sign(soft), every[np.argmax(metric)])
        differences = [(metric[every[:, m] > 0].max() - metric[every[:, m] < 0].max()) / 4.0 for m in range(9)]
        assert np.allclose(soft, differences)


def test_without_overlap_soft_values_are_the_matched_ones() -> None:
    matched = np.array([0.5, -2.0, 0.01])
    assert np.allclose(sequence_soft(matched, 0.0), matched)


def burst(noise: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.float64]]:
    generator = np.random.default_rng(6)
    waveform = np.asarray(generator.normal(size=44) + 1j * generator.normal(size=44), np.complex128)
    symbols = generator.choice([-1.0, 1.0], 200)
    heard = np.zeros(32 * 200 + 44, np.complex128)
    for m, symbol in enumerate(symbols):
        heard[32 * m : 32 * m + 44] += symbol * waveform
    heard += noise * (generator.normal(size=len(heard)) + 1j * generator.normal(size=len(heard)))
    return heard, waveform, symbols


@pytest.mark.parametrize("level", [1e-6, 1.0, 1e4])
def test_the_fixed_point_search_decides_like_the_floating_one_at_any_level(level: float) -> None:
    heard, waveform, symbols = burst(4.0)
    matched = matched_outputs(heard, waveform, 32, 200)
    overlap = float(np.vdot(waveform[32:], waveform[:-32]).real / np.sum(np.abs(waveform) ** 2))
    soft = sequence_soft(np.ascontiguousarray(matched.real), overlap)
    fixed = decide_q15(
        np.asarray(level * heard, np.complex128),
        np.zeros(len(heard), np.complex128),
        np.asarray(level * waveform, np.complex128),
        32,
        200,
    )
    clear = np.abs(soft) > 0.01  # words of Q15 behind a gain of a quarter decide down to about 1e-3
    assert np.array_equal(np.sign(soft)[clear], fixed[clear])
    assert np.count_nonzero(fixed != symbols) < 20


def test_words_saturate_instead_of_wrapping() -> None:
    assert quantised(np.array([0.5, 1.0, 7.0, -7.0]), 1.0).tolist() == [ONE // 2, ONE - 1, ONE - 1, -ONE]


def test_the_integer_search_is_the_plain_one() -> None:
    matched = np.array([3000, -200, 100, -5000], np.int64)
    every = np.array(list(product([1, -1], repeat=4)))
    metric = every @ matched - 900 * np.sum(every[:, 1:] * every[:, :-1], axis=1)
    assert np.array_equal(sequence_q15(matched, 900), every[np.argmax(metric)])
