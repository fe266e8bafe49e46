from __future__ import annotations

import math
import struct
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.motion_sensors.adis_frames import LENGTH, AdisFrames, adis_frame
from services.motion_sensors.imu_sample import STANDARD_GRAVITY_MPS2, ImuFrames
from services.motion_sensors.number_rows import ImuRows, NumberRows
from services.motion_sensors.vectornav_sentences import VectornavSentences, checksum
from services.motion_sensors.xsens_frames import XsensFrames


def adis(count: int) -> bytes:
    return b"".join(adis_frame((k % 50 - 7, 3, -4), (12, -9, 800 + k % 5), k) for k in range(count))


def vectornav(count: int) -> bytes:
    lines = []
    for k in range(count):
        forces, rates = f"{0.1 + k:+.3f},-00.200,+09.790", f"+00.001,-00.002,{0.003 * k:+.5f}"
        body = f"VNIMU,+00.1,+00.2,+00.3,{forces},{rates},+21.5,+101.3".encode()
        lines.append(b"$" + body + f"*{checksum(body):02X}\r\n".encode())
    return b"".join(lines)


def xsens_message(packets: bytes) -> bytes:
    body = b"\xff\x36" + (bytes([len(packets)]) if len(packets) < 255 else b"\xff" + len(packets).to_bytes(2, "big"))
    total = sum(body + packets) & 0xFF
    return b"\xfa" + body + packets + bytes([-total & 0xFF])


def xsens(count: int, letter: str = "f") -> bytes:
    form, size = (0, 12) if letter == "f" else (3, 24)
    messages = []
    for k in range(count):
        packets = b"\x10\x20\x02" + (k & 0xFFFF).to_bytes(2, "big") + b"\x10\x60\x04" + (100 * k).to_bytes(4, "big")
        packets += (0x4020 | form).to_bytes(2, "big") + bytes([size]) + struct.pack(f">3{letter}", 0.1, -0.2, 9.8 + k)
        packets += (0x8020 | form).to_bytes(2, "big") + bytes([size]) + struct.pack(f">3{letter}", 0.01, 0.02, 0.03)
        messages.append(xsens_message(packets))
    return b"".join(messages)


def rows(count: int) -> bytes:
    return b"".join(f"{0.01 * k:.2f},0.1,0.2,9.8,0.001,0.002,{0.003 + k}\n".encode() for k in range(count))


PROTOCOLS: list[tuple[str, Callable[[], ImuFrames], Callable[[int], bytes]]] = [
    ("adis", AdisFrames, adis),
    ("vectornav", VectornavSentences, vectornav),
    ("xsens", XsensFrames, xsens),
    ("rows", ImuRows, rows),
]
every_protocol = pytest.mark.parametrize(
    ("decoder", "encoded"), [one[1:] for one in PROTOCOLS], ids=[one[0] for one in PROTOCOLS]
)


@every_protocol
@given(cuts=st.lists(st.integers(1, 60), max_size=40))
def test_samples_are_the_same_however_the_bytes_are_cut(
    decoder: Callable[[], ImuFrames], encoded: Callable[[int], bytes], cuts: list[int]
) -> None:
    stream = encoded(8)
    whole, piecewise = decoder(), decoder()
    wanted = whole.feed(stream)
    got, at = [], 0
    for cut in cuts:
        got += piecewise.feed(stream[at : at + cut])
        at += cut
    got += piecewise.feed(stream[at:])
    assert len(wanted) == 8
    assert got == wanted


@every_protocol
@given(noise=st.binary(max_size=200))
def test_noise_before_a_stream_costs_no_later_sample(
    decoder: Callable[[], ImuFrames], encoded: Callable[[int], bytes], noise: bytes
) -> None:
    at_work = decoder()
    clean = decoder().feed(encoded(30))
    got = at_work.feed(noise) + at_work.feed(b"\n" + encoded(30))
    # Noise may swallow the frames that it seems to begin, never those long after it.
    assert got[-10:] == clean[-10:]


@every_protocol
@given(place=st.integers(0, 10_000), flip=st.integers(1, 255))
def test_a_damaged_byte_never_raises_and_is_counted_or_harmless(
    decoder: Callable[[], ImuFrames], encoded: Callable[[int], bytes], place: int, flip: int
) -> None:
    stream = bytearray(encoded(6))
    stream[place % len(stream)] ^= flip
    at_work = decoder()
    samples = at_work.feed(bytes(stream))
    assert len(samples) <= 8
    assert all(len(one.values) == 6 and all(map(math.isfinite, one.values)) for one in samples)
    assert at_work.counts["frames"] == len(samples)


def test_adis_counts_become_si_units() -> None:
    sample = AdisFrames().feed(adis_frame((10, -10, 0), (800, 0, -800), 5))[0]
    assert sample.values == pytest.approx(
        (STANDARD_GRAVITY_MPS2, 0.0, -STANDARD_GRAVITY_MPS2, math.radians(1.0), -math.radians(1.0), 0.0)
    )
    assert sample.temperature_c == pytest.approx(25.0)
    assert sample.counter == 5


def test_adis_status_bits_are_said_in_words() -> None:
    frame = bytearray(adis_frame((1, 1, 1), (1, 1, 1), 1))
    frame[1] |= 1 << 5
    frame[-2:] = (sum(frame[:-2]) & 0xFFFF).to_bytes(2, "big")
    assert AdisFrames().feed(bytes(frame))[0].fault == "sensor reports sensor"


def test_a_line_held_low_is_no_sensor_at_rest() -> None:
    decoder = AdisFrames()
    assert decoder.feed(bytes(10 * LENGTH)) == []
    assert decoder.counts["skipped_bytes"] > 0


def test_xsens_in_double_precision_and_with_an_extended_length() -> None:
    filler = b"\x20\x10\xff" + bytes(255)  # an orientation packet, which is passed over
    packets = (
        filler
        + b"\x40\x23\x18"
        + struct.pack(">3d", 1.0, 2.0, 3.0)
        + b"\x80\x23\x18"
        + struct.pack(">3d", 0.1, 0.2, 0.3)
    )
    assert XsensFrames().feed(xsens_message(packets))[0].values == (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    assert XsensFrames().feed(xsens(1, "d"))[0].values[2] == 9.8


def test_xsens_does_not_wait_for_a_message_longer_than_any() -> None:
    # A false start that claims 64 kB would swallow ten seconds of samples.
    decoder = XsensFrames()
    assert len(decoder.feed(b"\xfa\xff\x36\xff\xff\xff" + xsens(3))) == 3
    assert decoder.counts["checksum_errors"] == 1


def test_xsens_time_and_counter_are_kept() -> None:
    sample = XsensFrames().feed(xsens(3))[2]
    assert sample.counter == 2
    assert sample.device_s == pytest.approx(0.02)


def test_rows_without_a_number_are_counted_and_left_out() -> None:
    decoder = NumberRows(("t_s", "pulses"), ("t_s", "pulses"))
    assert decoder.feed(b"0.1,5\nhello\n0.2;7\n0.3 nan\n0.3,1e300\n\n0.4,9") == [(0.1, 5.0), (0.2, 7.0)]
    assert decoder.counts["skipped_bytes"] == len(b"hello") + len(b"0.3 nan") + len(b"0.3,1e300")


def test_a_missing_column_is_named() -> None:
    with pytest.raises(ValueError, match="no column gz_radps"):
        ImuRows(("ax_mps2", "ay_mps2", "az_mps2", "gx_radps", "gy_radps"))


def test_an_endless_line_is_dropped_not_kept() -> None:
    decoder = NumberRows(("pulses",), ("pulses",))
    for _ in range(100):
        decoder.feed(b"1" * 100)
    assert len(decoder._rest) <= 1024
