"""The channel simulator: filters that follow their response, blocks that join, noise as asked."""

from __future__ import annotations

import numpy as np
import pytest

from services.track_circuit.channel import FirFilter, filtered, fir_of, rail_fir
from services.track_circuit.rail import Rail, transfer
from services.track_circuit.traction_noise import InverterLine, TractionNoise, TractionSettings

RATE_HZ = 48_000.0


def test_the_filter_has_the_rails_response() -> None:
    rail = Rail(tuned_q=4.0)
    taps = rail_fir(rail, 0.5, 0.05, RATE_HZ)
    hz = np.fft.rfftfreq(8192, 1.0 / RATE_HZ)
    band = (hz > 7000.0) & (hz < 17_000.0)
    found = np.fft.rfft(taps, 8192)[band] * np.exp(2j * np.pi * hz[band] * (512 // 16) / RATE_HZ)
    wanted = transfer(rail, hz[band], 0.5, 0.05)
    # Cutting the response to 512 taps leaves errors below -60 dB.
    assert np.abs(found - wanted).max() < 1e-3 * np.abs(wanted).max()


def test_blocks_join_without_a_seam() -> None:
    rng = np.random.default_rng(1)
    samples, taps = rng.normal(size=3000), rng.normal(size=100)
    one = FirFilter(taps)
    parts = np.concatenate([one.pass_on(samples[a:b]) for a, b in ((0, 700), (700, 1000), (1000, 3000))])
    # Rounding of the transforms.
    np.testing.assert_allclose(parts, np.convolve(samples, taps)[:3000], atol=1e-10)
    np.testing.assert_allclose(filtered(samples, taps), parts, atol=1e-10)


def test_a_new_filter_fades_in_within_a_block() -> None:
    one = FirFilter(np.array([1.0]))
    faded = one.pass_on(np.ones(100), np.array([3.0]))
    assert faded[0] == pytest.approx(1.02)
    assert faded[-1] == pytest.approx(3.0)
    np.testing.assert_allclose(one.pass_on(np.ones(10)), 3.0)


def test_too_few_taps_are_refused() -> None:
    with pytest.raises(ValueError, match="too few"):
        fir_of(lambda hz: np.ones(len(hz), np.complex128), RATE_HZ, 32)


def test_noise_is_what_was_asked_for() -> None:
    settings = TractionSettings(white_rms=0.01, comb_amplitude=0.1, lines=(InverterLine(hz=3333.0, amplitude=0.05),))
    noise = TractionNoise(settings, RATE_HZ, np.random.default_rng(1))
    samples = np.concatenate([noise.block(k * 4800, 4800) for k in range(10)])
    spectrum = np.abs(np.fft.rfft(samples)) * 2.0 / len(samples)
    # One second: bins are 1 Hz; white noise adds 0.01 * sqrt(2 / 48000) of amplitude to each.
    assert spectrum[50] == pytest.approx(0.1, abs=1e-3)
    assert spectrum[2000] == pytest.approx(0.05, abs=1e-3)
    assert spectrum[3333] == pytest.approx(0.05, abs=1e-3)
    assert spectrum[1777] < 1e-3


def test_impulses_come_as_often_as_asked() -> None:
    settings = TractionSettings(impulses_per_s=50.0, impulse_amplitude=1.0)
    noise = TractionNoise(settings, RATE_HZ, np.random.default_rng(2))
    hits = np.count_nonzero(np.abs(np.concatenate([noise.block(k * 4800, 4800) for k in range(40)])) >= 0.999)
    # 200 expected of a Poisson number: five standard deviations are 71.
    assert 129 < hits < 271
