from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from services.track_circuit.equaliser import LinearReceiver
from services.track_circuit.equaliser_guards import ch1_gain, refuse_pilot_training
from services.track_circuit.profile import Profile
from services.track_circuit.receiver import Burst, ReceiverRefusedError, StoredTaps
from services.track_circuit.receiver_choice import RECEIVERS, receiver_named
from services.track_circuit.warm_start import CLAMP, aligned, held
from tests.unit.track_circuit.burst_scene import PROFILE, burst_of, random_bits, symbols_of


@pytest.mark.parametrize("name", RECEIVERS)
@pytest.mark.parametrize("gain", [1.0, 0.03j, -40.0 + 20.0j], ids=["plain", "faint and turned", "loud"])
def test_every_receiver_finds_the_bits_on_a_complex_channel(name: str, gain: complex) -> None:
    generator = np.random.default_rng(7)
    bits = random_bits(128, generator)
    # 0.35 per half chip and component of a chip's energy of about 2: 20 dB per bit.
    found = receiver_named(name, PROFILE).receive(burst_of(bits, 0.35 * abs(gain), generator, gain=gain))
    inner = slice(2, -2)
    assert np.array_equal(found.soft[inner] < 0.0, bits[inner] == 1)
    assert len(found.constellation) == 128
    assert found.evm_db < -6.0  # the paper's LMS, the least of them, is still learning here
    assert np.isfinite(found.error_db).all()


@pytest.mark.parametrize("name", RECEIVERS)
def test_every_receiver_starts_from_its_own_stored_taps(name: str) -> None:
    generator = np.random.default_rng(8)
    trial = random_bits(256, generator)
    known = burst_of(trial, 0.2, generator)
    learned = receiver_named(name, PROFILE).receive(Burst(known.samples, known.pilots, symbols_of(trial)))
    stored = StoredTaps(name, learned.taps)
    bits = random_bits(6, generator)
    few = burst_of(bits, 0.35, generator, gain=0.2 - 0.7j)
    found = receiver_named(name, PROFILE, stored).receive(few)
    assert np.array_equal(found.soft[:-1] < 0.0, bits[:-1] == 1)


def test_noise_costs_the_mlse_receiver_least() -> None:
    generator = np.random.default_rng(9)
    bits = random_bits(400, generator)
    burst = burst_of(bits, 2.6, generator)
    wrong = {n: int(np.sum((receiver_named(n, PROFILE).receive(burst).soft < 0.0) != (bits == 1))) for n in RECEIVERS}
    assert wrong["mlse"] <= min(wrong.values()) + 2
    assert wrong["mlse"] < 40 < 400 - wrong["lms"]


def test_stored_taps_of_another_receiver_are_refused() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        receiver_named("rls", PROFILE, StoredTaps("mlse", np.zeros(24, np.complex128)))
    with pytest.raises(ValueError, match="there are mlse"):
        receiver_named("viterbi", PROFILE)


@pytest.mark.parametrize(
    ("profile", "reason"),
    [
        (replace(PROFILE, ch2_row=15), "best row is 10"),
        (replace(PROFILE, code_length=8, ch2_row=6), "too short"),
        (replace(PROFILE, ch1_row=4), "row 2 alone"),
    ],
)
def test_linear_receivers_refuse_what_cannot_work(profile: Profile, reason: str) -> None:
    with pytest.raises(ReceiverRefusedError, match=reason):
        receiver_named("lms", profile)


def test_filters_as_long_as_the_code_are_refused() -> None:
    with pytest.raises(ReceiverRefusedError, match="null CH1"):
        LinearReceiver(PROFILE, "nlms", taps=32)
    refuse_pilot_training(PROFILE, 15.5)


def test_a_response_longer_than_a_symbol_is_refused_by_mlse() -> None:
    with pytest.raises(ReceiverRefusedError, match="at least 8"):
        receiver_named("mlse", replace(PROFILE, code_length=4, ch2_row=3))


def test_the_row_criterion_orders_rows_as_measured() -> None:
    assert ch1_gain(16, 14) > 0.5 < ch1_gain(16, 10)
    assert ch1_gain(16, 15) < 0.0
    assert max(ch1_gain(8, row) for row in range(3, 9)) < 0.5


def test_alignment_finds_gain_and_shift() -> None:
    generator = np.random.default_rng(10)
    taps = np.zeros(10, np.complex128)
    taps[3:7] = [0.2j, 1.0, -0.4 + 0.1j, 0.2]
    inputs = generator.normal(size=120) + 1j * generator.normal(size=120)
    moved = np.roll(taps, 1) * (0.3 - 2.0j)
    target = np.array([inputs[2 * k : 2 * k + 10] @ moved for k in range(31)])
    assert np.allclose(aligned(taps, inputs, target, 2), moved)


def test_adapted_taps_are_leaked_and_clamped() -> None:
    anchor, ones = np.array([3.0, 4.0], np.complex128), np.ones(2, np.complex128)
    assert np.allclose(held(np.asarray(anchor + ones), anchor), anchor + 0.98)
    far = held(np.asarray(anchor + 100.0 * ones), anchor)
    assert np.linalg.norm(far - anchor) == pytest.approx(CLAMP * 5.0)
