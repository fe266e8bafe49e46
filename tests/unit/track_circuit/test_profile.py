from __future__ import annotations

import msgspec
import numpy as np
import pytest

from services.track_circuit.profile import Framing, PnGenerator, Profile, ProfileError, decode_profile


def test_a_recordings_profile_decodes_and_leaves_unknown_fields() -> None:
    text = """{"scheme": "ss-cdma", "carrier_hz": 12000, "chip_rate_hz": 4800, "code_length": 16, "ch1_row": 2,
        "ch2_row": 14, "pilot_bits": "0110", "author": "somebody"}"""
    profile = decode_profile(text)
    assert profile.symbol_rate_hz == 300.0
    assert profile.pilots().tolist() == [1.0, -1.0, -1.0, 1.0]


def test_a_profile_with_telegrams_survives_its_own_json() -> None:
    profile = Profile(framing=Framing())
    assert decode_profile(msgspec.json.encode(profile)) == profile


def test_the_default_generator_has_the_longest_period_and_balance() -> None:
    bits = PnGenerator().bits(2 * 1023)
    assert np.array_equal(bits[:1023], bits[1023:])
    assert bits[:1023].sum() == 512
    signs = 1.0 - 2.0 * bits[:1023]
    shifted = np.fft.ifft(np.abs(np.fft.fft(signs)) ** 2).real
    assert np.allclose(shifted[1:], -1.0, atol=1e-6)  # m-sequence: every shift agrees in one place fewer than not


@pytest.mark.parametrize(
    ("field", "value", "named"),
    [
        ("code_length", 12, "code_length"),
        ("ch2_row", 17, "ch2_row"),
        ("ch2_row", 2, "ch1_row"),
        ("carrier_hz", -1.0, "carrier_hz"),
        ("pilot_bits", "01a", "pilot_bits"),
        ("scheme", "morse", "scheme"),
    ],
)
def test_contradictions_are_refused_by_name(field: str, value: object, named: str) -> None:
    with pytest.raises(ProfileError, match=named):
        decode_profile(msgspec.json.encode({field: value}))


def test_a_generator_that_cannot_run_is_refused() -> None:
    with pytest.raises(ProfileError, match="generator"):
        Profile(pilot_generator=PnGenerator(stages=4, taps=(5,))).pilots()
