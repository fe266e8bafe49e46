from __future__ import annotations

import numpy as np
import pytest

from services.track_circuit.interference import ToneFinder
from services.track_circuit.mlse import MlseReceiver
from services.track_circuit.receiver import Burst
from services.track_circuit.tone_cleaning import CleanReception
from services.track_circuit.tone_removal import ToneRemoval, overlaps, phasors
from tests.unit.track_circuit.burst_scene import PROFILE, burst_of, random_bits


def test_overlaps_are_the_phasors_inner_products() -> None:
    tones = np.array([0.1, 0.1 + 1e-4, -0.3, 0.25, 0.25])
    waves = phasors(tones, 500)[:, :500].astype(np.complex128)
    assert np.allclose(overlaps(tones, 500), np.conj(waves) @ waves.T, atol=1e-3)  # 500 terms of single precision


def test_tones_of_any_amplitude_are_found_together_and_nothing_else() -> None:
    generator = np.random.default_rng(1)
    tones = np.array([-0.31, 0.02, 0.0209, 0.4])
    amplitudes = np.array([1e-3, 3.0j, -2.0, 50.0])
    sum_of_tones = np.exp(2j * np.pi * np.outer(np.arange(1500), tones)) @ amplitudes
    noise = 0.01 * (generator.normal(size=1500) + 1j * generator.normal(size=1500))
    found = ToneRemoval(tones, 1500).tones_in(sum_of_tones + noise)
    # Of 1500 dimensions of noise four are taken along: 0.01 sqrt(2 * 4 / 1500).
    assert np.sqrt(np.mean(np.abs(found - sum_of_tones) ** 2)) < 2e-3


def with_tones(burst: Burst, tones: dict[float, complex], start: int) -> Burst:
    """A burst whose tones go on from burst to burst."""
    time = start + np.arange(len(burst.samples))
    added = sum((size * np.exp(2j * np.pi * tone * time) for tone, size in tones.items()), np.zeros(len(time)))
    return Burst(burst.samples + added, burst.pilots)


@pytest.mark.parametrize("data", ["random", "constant"])
@pytest.mark.parametrize("tones", [{}, {0.07: 1.5}, {0.07: 1.5, 0.251: 1.0j}], ids=["none", "beside", "within CH1"])
def test_ch1s_own_lines_stay_where_foreign_tones_go(data: str, tones: dict[float, complex]) -> None:
    generator = np.random.default_rng(2)
    receiver = CleanReception(PROFILE, MlseReceiver(PROFILE))
    wrong = total = 0
    for number in range(12):
        bits = np.zeros(68, np.int8) if data == "constant" else random_bits(68, generator)
        burst = with_tones(burst_of(bits, 0.3, generator), tones, 2206 * number)
        found, cleaned, _ = receiver.receive(burst, 12_000.0)
        wrong += int(np.count_nonzero((found.soft < 0.0)[2:-2] != (bits == 1)[2:-2]))
        total += 64
        assert len(cleaned.samples) == len(burst.samples)
    assert wrong == 0, f"{wrong} of {total}"


def test_a_comb_is_found_in_every_search() -> None:
    generator = np.random.default_rng(3)
    finder = ToneFinder(9_600.0)
    orders, turns = np.arange(150, 331), generator.random(181)
    for number in range(24):
        at = (np.arange(2_206) + 2_048 * number) / 9_600.0
        comb = np.exp(2j * np.pi * (np.outer(at, 50.02 * orders - 12_000.0) + turns)).sum(axis=1)
        finder.take(comb + 0.7 * (generator.normal(size=2_206) + 1j * generator.normal(size=2_206)))
        assert len(finder.tones(12_000.0)) >= 181


@pytest.mark.parametrize("hz_per_s", [2.0, 10.0])
def test_lines_that_drift_are_followed(hz_per_s: float) -> None:
    generator = np.random.default_rng(4)
    receiver = CleanReception(PROFILE, MlseReceiver(PROFILE))
    errors_db = []
    for number in range(30):
        bits = random_bits(68, generator)
        burst = burst_of(bits, 0.3, generator)
        at_s = (2206 * number + np.arange(2206)) / 9600.0
        drifting = 2.0 * np.exp(2j * np.pi * (500.0 * at_s + 0.5 * hz_per_s * at_s**2))
        found, _, _ = receiver.receive(Burst(burst.samples + drifting, burst.pilots), 12_000.0)
        errors_db.append(found.evm_db)
        assert np.array_equal((found.soft < 0.0)[2:-2], (bits == 1)[2:-2])
    # Without the line it is -21 dB; between two searches it moves by up to a fifth of what a burst resolves.
    assert np.median(errors_db) < -17.0


@pytest.mark.parametrize("size", [1.0, 30.0])
def test_a_single_line_is_no_comb(size: float) -> None:
    generator = np.random.default_rng(5)
    finder = ToneFinder(9_600.0)
    for number in range(40):
        at_s = (np.arange(2_206) + 2_048 * number) / 9_600.0
        line = size * np.exp(-2j * np.pi * 2_379.0 * at_s)
        finder.take(line + generator.normal(size=2_206) + 1j * generator.normal(size=2_206))
        assert len(finder.tones(12_000.0, urgent=True)) <= 4  # the line, and noise that stands out once in a while
    assert np.min(np.abs(finder.lines * 9_600.0 + 2_379.0)) < 1.0
