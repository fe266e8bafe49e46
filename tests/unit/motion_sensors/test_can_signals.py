from __future__ import annotations

from typing import Literal

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.motion_sensors.can_signals import CanImuLayout, CanImuSamples, CanSignal


@given(
    number=st.integers(0, 2**64 - 1),
    bits=st.integers(1, 64),
    start=st.integers(0, 63),
    order=st.sampled_from(("little", "big")),
    signed=st.booleans(),
)
def test_what_is_written_at_some_bits_is_read_there(
    number: int, bits: int, start: int, order: Literal["little", "big"], *, signed: bool
) -> None:
    number &= (1 << bits) - 1
    first = 8 * (start // 8) + 7 - start % 8
    shift = start if order == "little" else 64 - first - bits
    signal = CanSignal(frame_id=1, start_bit=start, bits=bits, order=order, signed=signed)
    if shift < 0 or shift + bits > 64:
        assert signal.raw(bytes(8)) is None
        return
    content = (number << shift).to_bytes(8, order)
    expected = number - (1 << bits) if signed and number >> (bits - 1) else number
    assert signal.raw(content) == expected


def layout() -> CanImuLayout:
    def at(frame_id: int, start_bit: int) -> CanSignal:
        return CanSignal(frame_id=frame_id, start_bit=start_bit, bits=16, signed=True, scale=0.01)

    return CanImuLayout(
        ax_mps2=at(0x100, 0),
        ay_mps2=at(0x100, 16),
        az_mps2=at(0x100, 32),
        gx_radps=at(0x101, 0),
        gy_radps=at(0x101, 16),
        gz_radps=at(0x101, 32),
        counter=CanSignal(frame_id=0x101, start_bit=48, bits=8),
    )


def words(*numbers: int) -> bytes:
    return b"".join(number.to_bytes(2, "little", signed=True) for number in numbers)


def test_a_sample_is_made_of_its_frames() -> None:
    samples = CanImuSamples(layout())
    assert samples.feed(0x100, words(100, -200, 981)) is None
    assert samples.feed(0x7FF, b"") is None
    sample = samples.feed(0x101, words(1, 2, -3, 9))
    assert sample is not None
    assert sample.values == pytest.approx((1.0, -2.0, 9.81, 0.01, 0.02, -0.03))
    assert sample.counter == 9
    assert samples.counter_modulus == 256


def test_a_sample_whose_first_frame_was_lost_is_not_made_of_old_values() -> None:
    samples = CanImuSamples(layout())
    samples.feed(0x100, words(100, -200, 981))
    assert samples.feed(0x101, words(1, 2, 3, 1)) is not None
    assert samples.feed(0x101, words(1, 2, 3, 2)) is None
    assert samples.counts["incomplete_samples"] == 1


def test_samples_whose_frames_are_lost_here_and_there_are_not_mixed() -> None:
    whole = layout()
    parts = msgspec.structs.replace(
        whole,
        gx_radps=msgspec.structs.replace(whole.gx_radps, frame_id=0x102),
        gy_radps=msgspec.structs.replace(whole.gy_radps, frame_id=0x102),
    )
    samples = CanImuSamples(parts)
    for frame_id, content in ((0x100, words(1, 1, 1)), (0x102, words(1, 1)), (0x100, words(2, 2, 2))):
        assert samples.feed(frame_id, content) is None
    # The rates of the second sample are those of the first one's frame.
    assert samples.feed(0x101, words(2, 2, 2, 2)) is None
    assert samples.counts["incomplete_samples"] == 2


def test_a_short_frame_is_counted() -> None:
    samples = CanImuSamples(layout())
    assert samples.feed(0x100, b"\x01") is None
    assert samples.counts["short_frames"] == 1


def test_a_layout_is_configuration() -> None:
    text = msgspec.json.encode(layout())
    assert msgspec.json.decode(text, type=CanImuLayout) == layout()
    with pytest.raises(msgspec.ValidationError, match="bits"):
        msgspec.json.decode(b'{"frame_id":1,"start_bit":0,"bits":65}', type=CanSignal)
