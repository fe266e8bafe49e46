from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from services.track_circuit.blanking import without_impulses
from services.track_circuit.interference import ToneFinder
from services.track_circuit.modulate import chips, passband, shaped
from services.track_circuit.profile import PnGenerator, Profile, ProfileError
from services.track_circuit.receiver_demodulation import Demodulator, demodulate, joined
from services.track_circuit.signal_front_end import FrontEnd
from services.track_circuit.tone_removal import ToneRemoval

RATE_HZ = 48_000.0
PROFILE = Profile()
BITS = np.random.default_rng(11).integers(0, 2, 420).astype(np.int8)


def recording(
    *, ppm: float = 0.0, offset_hz: float = 0.0, first_pilot: int = 0, rate_hz: float = RATE_HZ, noise: float = 0.5
) -> NDArray[np.float64]:
    """BITS with an echo of another phase; noise of 0.5 on a signal of power 1 per channel: 19 dB per bit."""
    moved = replace(PROFILE, chip_rate_hz=PROFILE.chip_rate_hz * (1.0 + ppm * 1e-6))
    clean = shaped(chips(BITS, PROFILE, first_pilot), moved, rate_hz)
    late = round(1.2 * rate_hz / PROFILE.chip_rate_hz)
    clean[late:] += 0.5j * clean[:-late]
    samples = passband(clean, PROFILE.carrier_hz + offset_hz, rate_hz, 1.0)
    return samples + noise * np.random.default_rng(12).normal(size=len(samples))


def assert_received(samples: NDArray[np.float64], *, first: int = 0, last: int = 419, rate_hz: float = RATE_HZ) -> None:
    found = demodulate(samples / np.abs(samples).max(), rate_hz, PROFILE)
    assert (found.symbol[0], found.symbol[-1]) == (first, last)
    assert np.array_equal(found.bit, BITS[found.symbol])


@pytest.mark.parametrize(("ppm", "hz"), [(0.0, 0.0), (50.0, 5.0), (-50.0, -5.0), (50.0, -5.0)])
def test_clock_and_carrier_offsets_are_followed(ppm: float, hz: float) -> None:
    found = demodulate(recording(ppm=ppm, offset_hz=hz), RATE_HZ, PROFILE)
    assert np.array_equal(found.bit, BITS[found.symbol])
    assert len(found.bit) == 420
    assert found.carrier_offset_hz[-1] == pytest.approx(hz, abs=0.1)  # 400 symbols at 19 dB
    assert found.clock_offset_ppm[-1] == pytest.approx(ppm, abs=10.0)  # the loop's own noise


@pytest.mark.parametrize("rate_hz", [44_100.0, 96_000.0])
def test_any_sample_rate_will_do(rate_hz: float) -> None:
    assert_received(recording(rate_hz=rate_hz), rate_hz=rate_hz)


@pytest.mark.parametrize("silence", [3, 57, 131, 5_000, 70_000])
def test_silence_may_come_first(silence: int) -> None:
    assert_received(np.concatenate([np.zeros(silence), recording()]))


@pytest.mark.parametrize(("cut", "first"), [(3, 0), (80, 1), (150, 1), (1_234, 8)])
def test_a_recording_may_begin_within_a_symbol(cut: int, first: int) -> None:
    assert_received(recording()[cut:], first=first)


def test_pilot_numbers_go_on_where_a_recording_begins_late() -> None:
    found = demodulate(recording(first_pilot=600), RATE_HZ, PROFILE)
    assert found.symbol[0] == 600
    assert np.array_equal(found.bit, BITS)


@pytest.mark.parametrize("seed", [8, 53, 76, 79])
def test_noise_before_the_first_symbol_does_not_number_it_a_period_too_high(seed: int) -> None:
    # Each of these beginnings holds a symbol of noise, or several, that looks like one of CH2's.
    generator = np.random.default_rng(seed)
    clean = recording(noise=0.0)
    samples = np.concatenate([np.zeros(1600 + 13 * seed), clean])
    samples += 2.2 * generator.normal(size=len(samples))
    found = demodulate(samples / np.abs(samples).max(), RATE_HZ, PROFILE)
    assert found.symbol[0] in (0, 1)
    assert np.mean(found.bit != BITS[found.symbol]) < 0.01  # 9 dB per bit: 3e-5


@pytest.mark.parametrize("first", [1015, 1021, 1022])
def test_a_recording_may_begin_just_before_the_pilot_repeats(first: int) -> None:
    found = demodulate(recording(first_pilot=first), RATE_HZ, PROFILE)
    assert np.array_equal(found.symbol, first + np.arange(420))
    assert np.array_equal(found.bit, BITS)


@pytest.mark.parametrize("row", [3, 13, 15])
def test_rows_that_hardly_excite_ch1s_band_do_not_lead_mlse_astray(row: int) -> None:
    profile = replace(PROFILE, ch2_row=row)
    clean = shaped(chips(BITS, profile), profile, RATE_HZ)
    clean[12:] += 0.5j * clean[:-12]
    noise = np.random.default_rng(17).normal(size=len(clean))
    found = demodulate(passband(clean, profile.carrier_hz, RATE_HZ, 1.0) + noise, RATE_HZ, profile)
    assert np.array_equal(found.bit, BITS)


@pytest.mark.parametrize(("length", "row"), [(8, 6), (8, 8), (32, 30), (64, 62)])
def test_other_lengths_of_code_are_received(length: int, row: int) -> None:
    profile = replace(PROFILE, code_length=length, ch2_row=row)
    clean = shaped(chips(BITS, profile), profile, RATE_HZ)
    clean[12:] += 0.5j * clean[:-12]
    noise = np.random.default_rng(18).normal(size=len(clean))
    found = demodulate(passband(clean, profile.carrier_hz, RATE_HZ, 1.0) + 0.7 * noise, RATE_HZ, profile)
    assert np.array_equal(found.bit[: len(BITS)], BITS)


def test_lost_samples_are_noticed_and_numbers_stay_right() -> None:
    samples = recording()
    found = demodulate(np.concatenate([samples[:20_000], samples[20_477:]]), RATE_HZ, PROFILE)
    assert found.losses == 1
    assert len(found.bit) > 300
    assert np.mean(found.bit != BITS[found.symbol]) < 0.01  # the symbols around the loss


def test_pieces_give_what_the_whole_gives() -> None:
    samples = recording()
    demodulator = Demodulator(RATE_HZ, PROFILE)
    parts = [demodulator.take(part) for part in np.array_split(samples, 7)] + [demodulator.finish()]
    whole = joined([part for part in parts if len(part.bit)])
    assert np.array_equal(whole.symbol, np.arange(420))
    assert np.array_equal(whole.bit, BITS)


@pytest.mark.parametrize("samples", [np.zeros(60_000), np.random.default_rng(13).normal(size=60_000), np.empty(0)])
def test_without_signal_there_are_no_bits_but_a_reason(samples: NDArray[np.float64]) -> None:
    found = demodulate(samples, RATE_HZ, PROFILE)
    assert len(found.bit) == 0
    assert "no signal" in found.refused


def test_a_neighbour_with_another_pilot_is_no_signal() -> None:
    other = replace(PROFILE, pilot_generator=PnGenerator(taps=(10, 3), seed=77))
    assert demodulate(recording(noise=0.1), RATE_HZ, other).refused


@pytest.mark.parametrize("samples", [np.array([0.0, np.nan]), np.zeros((2, 2))])
def test_samples_that_are_no_row_of_numbers_are_refused(samples: NDArray[np.float64]) -> None:
    with pytest.raises(ValueError, match="one row of finite"):
        demodulate(samples, RATE_HZ, PROFILE)


def test_a_sample_rate_below_the_chips_and_another_scheme_are_refused() -> None:
    with pytest.raises(ValueError, match="fewer than two per chip"):
        Demodulator(8_000.0, PROFILE)
    with pytest.raises(ProfileError, match="fsk"):
        Demodulator(RATE_HZ, Profile(scheme="fsk"))


@pytest.mark.parametrize("tone_hz", [9_620.0, 14_301.7])
def test_a_tone_as_strong_as_the_signal_in_its_band_is_taken_out(tone_hz: float) -> None:
    samples = recording()
    tone = 1.4 * np.sin(2.0 * np.pi * tone_hz * np.arange(len(samples)) / RATE_HZ)
    found = demodulate(samples + tone, RATE_HZ, PROFILE)
    assert np.array_equal(found.bit, BITS[found.symbol])
    assert min(abs(line - tone_hz) for line in found.lines_hz) < 2.0  # a burst resolves 4 Hz


def test_constant_data_is_a_tone_that_is_left_alone() -> None:
    samples = passband(shaped(chips(np.zeros(300, np.int8), PROFILE), PROFILE, RATE_HZ), PROFILE.carrier_hz, RATE_HZ)
    found = demodulate(samples + 0.3 * np.random.default_rng(14).normal(size=len(samples)), RATE_HZ, PROFILE)
    assert found.bit.sum() == 0
    assert len(found.bit) == 300


def test_the_mains_comb_is_found_by_its_fundamental() -> None:
    generator = np.random.default_rng(15)
    finder = ToneFinder(9_600.0)
    time = np.arange(2_100) / 9_600.0
    turns = generator.random(400)
    for burst in range(8):
        at = time + burst * 0.3
        comb = sum(np.exp(2j * np.pi * ((50.02 * k - 12_000.0) * at + turns[k])) for k in range(150, 331))
        noise = generator.normal(size=2_100) + 1j * generator.normal(size=2_100)
        samples = 0.2 * comb + noise
        finder.take(samples)
    tones = finder.tones(12_000.0)
    assert len(tones) >= 180
    orders = (tones * 9_600.0 + 12_000.0) / 50.02
    assert np.abs(orders - np.rint(orders)).max() * 50.02 < 2.0  # half of what a burst resolves
    left = float(np.mean(np.abs(samples - ToneRemoval(tones, len(samples)).tones_in(samples)) ** 2))
    assert left < float(np.mean(np.abs(noise) ** 2)) * 1.05


def test_impulses_are_blanked_and_nothing_else() -> None:
    samples = recording(noise=0.2)
    struck = samples.copy()
    struck[[5_000, 20_000, 20_001]] = [30.0, -25.0, 40.0]
    cleaned, count = without_impulses(struck, 160)
    # One sample and a pair with two neighbours to either side, and the few peaks of noise beyond the limit.
    assert 11 <= count <= 40
    assert np.abs(cleaned).max() < 5.0
    assert np.mean(cleaned != samples) < 1e-3
    assert without_impulses(np.zeros(1000), 160)[1] == 0


def test_white_noise_stays_white_and_a_carrier_becomes_its_phasor() -> None:
    front_end = FrontEnd(RATE_HZ, 4_800.0)
    noise = np.random.default_rng(16).normal(size=200_000)
    baseband = front_end.baseband(noise, 500.0, 5.003, 39_000, 12_000.0, 0.0)
    spectrum = np.abs(np.fft.fft(baseband.reshape(-1, 100), axis=1)) ** 2
    assert spectrum.mean(axis=0).std() / spectrum.mean() < 0.1  # 390 spectra: 5 % by chance
    turns = 12_000.0 * np.arange(4_000) / RATE_HZ
    phasor = front_end.baseband(3.0 * np.cos(2.0 * np.pi * turns + 0.7), 1_000.0, 5.0, 300, 12_000.0, 0.0)
    assert np.allclose(phasor, 3.0 * np.exp(0.7j), atol=0.01)  # what the filter leaves of twice the carrier
