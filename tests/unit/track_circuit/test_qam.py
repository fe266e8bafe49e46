from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from services.track_circuit.cdma_qam import (
    despread_symbols,
    modulate_cdma_qam,
    spread_symbols,
    training_symbols,
)
from services.track_circuit.modulate import passband, shaped
from services.track_circuit.profile import Profile, ProfileError
from services.track_circuit.qam import bits_per_symbol, levels, nearest, qam_bits, qam_points, theoretical_ber
from services.track_circuit.qam_demodulation import QamDemodulator
from services.track_circuit.qam_equaliser import LEAD, equalise, train
from services.track_circuit.receiver import Demodulation, StoredTaps
from services.track_circuit.receiver_demodulation import joined

ORDERS = (4, 16, 64)


@pytest.mark.parametrize("order", ORDERS)
def test_bits_survive_the_constellation_and_power_is_one(order: int) -> None:
    bits = np.random.default_rng(1).integers(0, 2, 3000 * bits_per_symbol(order)).astype(np.int8)
    points = qam_points(bits, order)
    assert np.array_equal(qam_bits(points, order), bits)
    assert np.array_equal(nearest(points * 1.0001, order), points)
    assert np.mean(np.abs(points) ** 2) == pytest.approx(1.0, abs=0.05)  # 3000 points
    assert len(np.unique(np.round(points, 9))) == order


@pytest.mark.parametrize("order", ORDERS)
def test_neighbours_differ_in_one_bit(order: int) -> None:
    grid = levels(order)
    bits = [qam_bits(np.array([level + 1j * grid[0]]), order) for level in grid]
    assert all(np.count_nonzero(a != b) == 1 for a, b in pairwise(bits))


def test_counted_errors_are_the_theorys() -> None:
    generator = np.random.default_rng(2)
    bits = generator.integers(0, 2, 400_000).astype(np.int8)
    sigma = np.sqrt(0.5 / (4.0 * 10.0**0.9))  # 9 dB per bit, four bits of unit power
    noise = sigma * (generator.normal(size=100_000) + 1j * generator.normal(size=100_000))
    rate = np.mean(qam_bits(qam_points(bits, 16) + noise, 16) != bits)
    assert rate == pytest.approx(theoretical_ber(16, 9.0), rel=0.08)  # 1800 errors and the farther neighbours


def test_an_unknown_order_is_refused() -> None:
    with pytest.raises(ValueError, match="order 32"):
        levels(32)


@pytest.mark.parametrize("feedback", [0, 4])
def test_stored_coefficients_need_few_symbols_on_a_turned_complex_channel(feedback: int) -> None:
    generator = np.random.default_rng(3)
    symbols = qam_points(generator.integers(0, 2, 4 * 1000).astype(np.int8), 16)
    sparse = np.zeros(2 * 1000 + 4 * LEAD, np.complex128)
    sparse[2 * LEAD : 2 * LEAD + 2000 : 2] = symbols
    heard = np.convolve(sparse, [0.3j, 1.0, 0.5 - 0.4j, 0.2j, -0.1])[1 : 1 + len(sparse)]
    heard += 0.02 * (generator.normal(size=len(heard)) + 1j * generator.normal(size=len(heard)))
    stored = train(heard, symbols[:600], feedback=feedback)
    turned = heard * (0.3 - 0.9j)
    taps = train(turned, symbols[:16], stored, feedback=feedback)
    points = equalise(turned[32:], taps, 16, 900, symbols[:16][::-1])
    assert np.array_equal(nearest(points, 16), symbols[16:916])


@pytest.mark.parametrize("order", ORDERS)
def test_codes_on_i_and_q_stand_on_the_constellation_and_come_back(order: int) -> None:
    profile = replace(Profile(scheme="cdma-qam"), qam_order=order)
    bits = np.random.default_rng(4).integers(0, 2, 40 * profile.bits_per_block).astype(np.int8)
    symbols = spread_symbols(bits, profile)
    assert np.allclose(nearest(symbols, order), symbols)
    assert np.allclose(despread_symbols(symbols, profile), 1.0 - 2.0 * bits)


@pytest.mark.parametrize("order", [16, 64])
@pytest.mark.parametrize("offset_hz", [0.0, 5.0, -5.0])
def test_a_frame_is_found_and_received_behind_a_rail_with_an_echo(order: int, offset_hz: float) -> None:
    profile = replace(Profile(scheme="cdma-qam"), qam_order=order)
    generator = np.random.default_rng(5)
    bits = generator.integers(0, 2, 60 * profile.bits_per_block).astype(np.int8)
    symbols = np.concatenate([training_symbols(profile), spread_symbols(bits, profile)])
    clean = shaped(symbols, profile, 48_000.0)
    clean[7:] += 0.3j * clean[:-7]
    samples = np.concatenate([np.zeros(443), passband(clean, profile.carrier_hz + offset_hz, 48_000.0, 2.0)])
    samples += 0.05 * generator.normal(size=len(samples))
    found = received(samples, profile)
    # 64 symbols of training stand before the first bit; the echo pulls by less than a symbol.
    assert found.sample[0] == pytest.approx(443 + 640, abs=12)
    assert np.array_equal(found.bit[: len(bits)], bits)
    assert found.evm_db[0] < -15.0  # the codes' spreading gains what the carrier's offset costs


def received(samples: NDArray[np.float64], profile: Profile, receiver: str = "dfe", pieces: int = 1) -> Demodulation:
    demodulator = QamDemodulator(48_000.0, profile, receiver)
    parts = [demodulator.take(part) for part in np.array_split(samples, pieces)] + [demodulator.finish()]
    heard = [part for part in parts if len(part.bit)]
    return joined(heard) if heard else parts[-1]


def sent(bits: NDArray[np.int8], profile: Profile, *, ppm: float = 0.0, seed: int = 7) -> NDArray[np.float64]:
    """Behind some silence, with noise 25 dB below, on a sender whose whole clock is off."""
    clean = modulate_cdma_qam(bits, profile, 48_000.0 / (1.0 + ppm * 1e-6))
    samples = np.concatenate([np.zeros(700), clean, np.zeros(300)])
    noise = np.random.default_rng(seed).normal(size=len(samples)) * (0.06 * float(clean.std()))
    return np.asarray(samples + noise, np.float64)


@pytest.mark.parametrize("order", [16, 64])
@pytest.mark.parametrize("ppm", [50.0, -50.0])
@pytest.mark.parametrize("blocks", [0, 30])
def test_clocks_are_followed_and_frames_join(order: int, ppm: float, blocks: int) -> None:
    profile = replace(
        Profile(scheme="cdma-qam", pulse="root-raised-cosine", carrier_hz=12_000.0 / (1.0 + ppm * 1e-6)),
        qam_order=order,
        qam_blocks=blocks,
    )
    bits = np.random.default_rng(6).integers(0, 2, 1200 * profile.bits_per_block).astype(np.int8)
    found = received(sent(bits, profile, ppm=ppm), profile, pieces=37)
    assert np.array_equal(found.symbol[: len(bits)], np.arange(len(bits)))
    assert np.array_equal(found.bit[: len(bits)], bits)
    assert found.losses == 0
    assert (np.diff(found.sample) > 0.0).all()


@pytest.mark.parametrize("receiver", ["dfe", "least-squares"])
def test_a_gap_is_sought_over_and_numbers_go_on_by_time(receiver: str) -> None:
    profile = replace(Profile(scheme="cdma-qam", pulse="root-raised-cosine"), qam_blocks=20)
    bits = np.random.default_rng(8).integers(0, 2, 400 * profile.bits_per_block).astype(np.int8)
    samples = sent(bits, profile)
    found = received(np.concatenate([samples[:21_000], np.zeros(7_777), samples[21_000:]]), profile, receiver)
    assert found.losses >= 1
    jumps = np.diff(found.symbol)
    assert jumps.min() == 1
    assert 1 <= np.count_nonzero(jumps != 1) <= 3  # blocks around the gap are cut one by one
    after = found.sample > 30_000
    wanted = 20 * profile.bits_per_block
    late = found.bit[after]
    # Behind the gap every frame of 20 blocks is one that was sent.
    frames = {bits[k : k + wanted].tobytes() for k in range(0, len(bits), wanted)}
    assert all(late[k : k + wanted].tobytes() in frames for k in range(0, len(late) // wanted * wanted, wanted))
    assert len(late) > 5 * wanted


def test_stored_coefficients_must_fit_the_receiver() -> None:
    profile = Profile(scheme="cdma-qam")
    with pytest.raises(ValueError, match="do not fit"):
        QamDemodulator(48_000.0, profile, "dfe", StoredTaps("least-squares", np.ones(16, np.complex128)))
    with pytest.raises(ValueError, match="16 stored coefficients for 20"):
        QamDemodulator(48_000.0, profile, "dfe", StoredTaps("dfe", np.ones(16, np.complex128)))
    with pytest.raises(ProfileError, match="mlse"):
        QamDemodulator(48_000.0, profile, "mlse")


def test_noise_has_no_frame_and_rows_must_fit() -> None:
    profile = Profile(scheme="cdma-qam")
    found = received(np.random.default_rng(6).normal(size=30_000), profile, pieces=5)
    assert (len(found.bit), "no CDMA-QAM training" in found.refused) == (0, True)
    assert received(np.zeros(100), profile).refused
    with pytest.raises(ValueError, match="no multiple of the 6"):
        spread_symbols(np.zeros(7, np.int8), profile)
    with pytest.raises(ProfileError, match="qam_rows"):
        modulate_cdma_qam(np.zeros(6, np.int8), replace(profile, qam_rows=(1, 1, 3)), 48_000.0)
