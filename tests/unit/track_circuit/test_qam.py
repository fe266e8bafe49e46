from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace

from services.track_circuit.cdma_qam import (
    bits_per_block,
    despread_symbols,
    modulate_cdma_qam,
    receive_cdma_qam,
    spread_symbols,
    training_symbols,
)
from services.track_circuit.modulate import passband, shaped
from services.track_circuit.profile import Profile, ProfileError
from services.track_circuit.qam import bits_per_symbol, levels, nearest, qam_bits, qam_points, theoretical_ber
from services.track_circuit.qam_equaliser import LEAD, equalise, train

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
    bits = np.random.default_rng(4).integers(0, 2, 40 * bits_per_block(profile)).astype(np.int8)
    symbols = spread_symbols(bits, profile)
    assert np.allclose(nearest(symbols, order), symbols)
    assert np.allclose(despread_symbols(symbols, profile), 1.0 - 2.0 * bits)


@pytest.mark.parametrize("order", [16, 64])
@pytest.mark.parametrize("offset_hz", [0.0, 5.0, -5.0])
def test_a_frame_is_found_and_received_behind_a_rail_with_an_echo(order: int, offset_hz: float) -> None:
    profile = replace(Profile(scheme="cdma-qam"), qam_order=order)
    generator = np.random.default_rng(5)
    bits = generator.integers(0, 2, 60 * bits_per_block(profile)).astype(np.int8)
    symbols = np.concatenate([training_symbols(profile), spread_symbols(bits, profile)])
    clean = shaped(symbols, profile, 48_000.0)
    clean[7:] += 0.3j * clean[:-7]
    samples = np.concatenate([np.zeros(443), passband(clean, profile.carrier_hz + offset_hz, 48_000.0, 2.0)])
    samples += 0.05 * generator.normal(size=len(samples))
    found = receive_cdma_qam(samples, 48_000.0, profile)
    assert found is not None
    assert found.begin == pytest.approx(443, abs=12)  # the echo pulls by less than a symbol
    assert np.array_equal(found.soft < 0.0, bits == 1)
    assert found.evm_db < -15.0  # the codes' spreading gains what the carrier's offset costs


def test_noise_has_no_frame_and_rows_must_fit() -> None:
    profile = Profile(scheme="cdma-qam")
    assert receive_cdma_qam(np.random.default_rng(6).normal(size=30_000), 48_000.0, profile) is None
    assert receive_cdma_qam(np.zeros(100), 48_000.0, profile) is None
    with pytest.raises(ValueError, match="no multiple of the 6"):
        spread_symbols(np.zeros(7, np.int8), profile)
    with pytest.raises(ProfileError, match="qam_rows"):
        modulate_cdma_qam(np.zeros(6, np.int8), replace(profile, qam_rows=(1, 1, 3)), 48_000.0)
