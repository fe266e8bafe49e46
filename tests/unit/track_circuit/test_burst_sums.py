from __future__ import annotations

import numpy as np
import pytest

from services.track_circuit.burst_sums import matched_without_pilot
from services.track_circuit.channel_estimate import LEAD, TAPS, NormalEquations, observed_rows, response, rows_of
from services.track_circuit.mlse import matched_outputs

GENERATOR = np.random.default_rng(31)
ROUNDING = 1e-10
"""Of sums of some thousand products of order 1 that are added in another order."""


@pytest.mark.parametrize("symbols", [1, 2, 41])
def test_a_bursts_normal_equations_are_those_of_its_rows(symbols: int) -> None:
    chips = GENERATOR.choice([-2.0, 0.0, 2.0], 16 * symbols)
    count = 2 * (LEAD + len(chips) + TAPS)
    samples = GENERATOR.normal(size=count) + 1j * GENERATOR.normal(size=count)
    plain, quick = NormalEquations(), NormalEquations()
    for _ in range(2):
        plain.add(np.ascontiguousarray(rows_of(chips)), observed_rows(samples, len(chips)))
        quick.add_burst(chips, samples)
    assert np.allclose(quick.matrix, plain.matrix, atol=ROUNDING)
    assert np.allclose(quick.right, plain.right, atol=ROUNDING)
    assert quick.energy == pytest.approx(plain.energy, rel=ROUNDING)
    assert quick.rows == plain.rows


@pytest.mark.parametrize("cut", [0, 1, 47])
def test_the_matched_filter_takes_the_pilot_off_and_sees_silence_behind_the_samples(cut: int) -> None:
    symbols = 20
    pilot_chips = GENERATOR.choice([-1.0, 1.0], 16 * symbols)
    taps = GENERATOR.normal(size=(2, TAPS)) + 1j * GENERATOR.normal(size=(2, TAPS))
    waveform = response(taps, pilot_chips[:16])
    samples = (GENERATOR.normal(size=700) + 1j * GENERATOR.normal(size=700))[: 700 - cut]
    rest = np.zeros(32 * (symbols - 1) + len(waveform), np.complex128)
    length = min(len(rest), len(samples))
    rest[:length] = samples[:length] - response(taps, pilot_chips)[:length]
    found = np.empty(symbols, np.complex128)
    matched_without_pilot(samples, pilot_chips, taps, waveform, 32, found)
    assert np.allclose(found, matched_outputs(rest, waveform, 32, symbols), atol=ROUNDING)
