"""The given spread-spectrum recording, cut, on other clocks, and under what traction does to it: every bit is right."""

from __future__ import annotations

import json
import os
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from services.track_circuit.profile import Profile, decode_profile
from services.track_circuit.receiver_demodulation import demodulate

FOLDER = Path(os.environ.get("KIROTEI_FIELD_DATA", "/nonexistent")) / "track_circuit"
pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason="KIROTEI_FIELD_DATA names no folder with track_circuit")
RATE_HZ = 48_000.0
SYMBOLS = 1200
"""Of 160 samples each, from the begin: four seconds are enough."""
Samples = NDArray[np.float64]


@cache
def given() -> tuple[Samples, NDArray[np.int8], Profile]:
    meta = json.loads((FOLDER / "syn_sscdma_12k_N16.sigmf-meta").read_text("utf-8"))["global"]
    samples = np.fromfile(FOLDER / "syn_sscdma_12k_N16.sigmf-data", "<i2")[: 160 * SYMBOLS] / 32768.0
    truth = np.array([int(bit) for bit in meta["trackcircuit:truth"]["data_bits"]], np.int8)
    return samples, truth, decode_profile(msgspec.json.encode(meta["trackcircuit:profile"]))


def seconds(samples: Samples) -> Samples:
    return np.arange(len(samples)) / RATE_HZ


def moved(samples: Samples, hz: float) -> Samples:
    """Every frequency that much higher."""
    spectrum = np.fft.fft(samples)
    spectrum[len(samples) // 2 :] = 0.0
    return np.asarray(2.0 * (np.fft.ifft(spectrum) * np.exp(2j * np.pi * hz * seconds(samples))).real, np.float64)


def on_clock(samples: Samples, ppm: float) -> Samples:
    """As a sender on a faster clock would have sent it: interpolated by a windowed sinc of 32 samples."""
    at = np.arange(len(samples) - 64) * (1.0 + ppm * 1e-6)
    whole = np.floor(at).astype(np.int64)
    padded, found = np.pad(samples, 64), np.zeros(len(at))
    for k in range(-15, 17):
        distance = at - whole - k
        found += padded[whole + k + 64] * np.sinc(distance) * np.cos(np.pi * distance / 33.0) ** 2
    return found


def with_rms(disturbance: Samples, samples: Samples, ratio_db: float) -> Samples:
    """Samples and a disturbance `ratio_db` below them in power."""
    factor = float(samples.std() / disturbance.std()) * 10.0 ** (-ratio_db / 20.0)
    return np.asarray(samples + factor * disturbance, np.float64)


def assert_every_bit(samples: Samples, *, first: int = 0, missing: int = 0) -> None:
    """All bits from `first` on, `missing` of them at the ends."""
    _, truth, profile = given()
    words = np.rint(samples * (20_000.0 / np.abs(samples).max()))
    found = demodulate(words / 32768.0, RATE_HZ, profile)
    assert first <= found.symbol[0] <= first + missing
    assert len(found.bit) >= SYMBOLS - first - missing
    inside = found.symbol < len(truth)
    assert np.array_equal(found.bit[inside], truth[found.symbol[inside]])
    assert np.count_nonzero(~inside) <= 1


@pytest.mark.parametrize(("ppm", "hz", "cut"), [(50.0, 5.0, 0), (-50.0, -5.0, 77_777), (50.0, -5.0, 100_001)])
def test_clock_carrier_and_begin_may_be_any(ppm: float, hz: float, cut: int) -> None:
    samples, _, _ = given()
    assert_every_bit(moved(on_clock(samples, ppm), hz)[cut:], first=cut // 160, missing=2)


@pytest.mark.parametrize("before", [17, 150, 401, 48_000])
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_silence_or_noise_may_come_first(before: int, noise: float) -> None:
    samples, _, _ = given()
    silence = noise * samples.std() * np.random.default_rng(before).normal(size=before)
    assert_every_bit(np.concatenate([silence, samples]))


@pytest.mark.parametrize("mains_hz", [50.0, 49.97, 60.03])
@pytest.mark.parametrize("ratio_db", [5.0, -5.0])
def test_the_mains_comb_over_the_whole_band(mains_hz: float, ratio_db: float) -> None:
    samples, _, _ = given()
    size = 1 << 17  # of one period: its places are right to a hundredth of a turn of the highest harmonic
    spectrum = np.zeros(size // 2 + 1, np.complex128)
    spectrum[1:391] = np.exp(2j * np.pi * np.random.default_rng(1).random(390))
    period = np.fft.irfft(spectrum)
    comb = period[np.rint(mains_hz * seconds(samples) * size).astype(np.int64) % size]
    assert_every_bit(with_rms(comb, samples, ratio_db))


@pytest.mark.parametrize("hz", [9_600.0, 9_621.0, 11_000.0, 12_250.0, 14_385.0, 14_400.0])
@pytest.mark.parametrize("ratio_db", [10.0, 0.0, -10.0])
def test_an_inverter_line_anywhere(hz: float, ratio_db: float) -> None:
    samples, _, _ = given()
    assert_every_bit(with_rms(np.cos(2.0 * np.pi * hz * seconds(samples) + 1.0), samples, ratio_db))


@pytest.mark.parametrize(("hz_per_s", "ratio_db"), [(2.0, -6.0), (10.0, -6.0), (30.0, 0.0), (500.0, 6.0)])
def test_inverter_lines_that_drift(hz_per_s: float, ratio_db: float) -> None:
    samples, _, _ = given()
    t = seconds(samples)
    lines = [np.cos(2.0 * np.pi * (hz * t + 0.5 * hz_per_s * t**2)) for hz in (9_000.0, 12_500.0)]
    assert_every_bit(with_rms(lines[0] + lines[1], samples, ratio_db))


def test_noise_impulses_clipping_and_a_constant() -> None:
    samples, _, _ = given()
    generator = np.random.default_rng(2)
    assert_every_bit(with_rms(generator.normal(size=len(samples)), samples, -3.0))
    struck = samples.copy()
    struck[generator.integers(0, len(samples), 500)] += 20.0 * samples.std()
    assert_every_bit(struck)
    assert_every_bit(np.clip(samples, -0.7 * samples.std(), 0.7 * samples.std()))
    assert_every_bit(samples + 5.0 * samples.std())
