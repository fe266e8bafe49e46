from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from services.track_circuit.modulate import chips, modulate, root_raised_cosine, shaped
from services.track_circuit.profile import Profile
from services.track_circuit.walsh import code


def test_delay_and_add_cancels_a_constant_ch1() -> None:
    profile = Profile()
    sent = chips(np.zeros(20, np.int8), profile)
    pilot = np.outer(profile.pilots()[:20], code(16, 14)).ravel()
    assert np.array_equal(sent[1:] + sent[:-1], pilot[1:] + pilot[:-1])


def test_despreading_gives_the_bits_back() -> None:
    bits = np.random.default_rng(1).integers(0, 2, 50)
    blocks = chips(bits, Profile(), first_pilot=77).reshape(-1, 16)
    assert np.array_equal(blocks @ code(16, 2) / 16, 1.0 - 2.0 * bits)


def test_the_root_raised_cosine_is_a_nyquist_pulse_behind_its_like() -> None:
    times = np.arange(-40.0, 40.0, 0.125)
    both = np.convolve(root_raised_cosine(times, 0.35), root_raised_cosine(times, 0.35)) * 0.125
    at_chips = both[int(np.argmax(both)) % 8 :: 8]
    peak = int(np.argmax(at_chips))
    assert at_chips[peak] == pytest.approx(1.0, abs=1e-3)  # the pulse is cut at 40 chips
    assert np.abs(np.delete(at_chips, peak)).max() < 1e-3


@pytest.mark.parametrize("rate_hz", [48_000.0, 44_100.0, 96_000.0])
def test_rectangular_chips_keep_their_area_at_any_rate(rate_hz: float) -> None:
    profile = Profile()
    values = np.array([1.0, -2.0, 0.0, 2.0] * 50)
    total = shaped(values, profile, rate_hz).sum().real * profile.chip_rate_hz / rate_hz
    assert total == pytest.approx(values.sum(), abs=2.0)  # half a sample at either end


@pytest.mark.parametrize("pulse", ["rectangular", "root-raised-cosine"])
def test_the_carrier_carries_both_channels(pulse: str) -> None:
    profile = replace(Profile(), pulse=pulse)
    samples = modulate(np.random.default_rng(2).integers(0, 2, 400), profile, 48_000.0)
    # Two channels of amplitude 1 on a carrier: mean power 1. Samples on edges of rectangular chips are averages; at
    # four samples per cycle every fifth sample that counts is one.
    assert np.mean(samples**2) == pytest.approx(1.0, rel=0.2)
