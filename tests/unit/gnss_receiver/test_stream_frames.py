"""Frames in streams that are cut, damaged, mixed and full of garbage."""

from __future__ import annotations

import re
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.gnss_receiver.crc24q import crc24q
from services.gnss_receiver.rtcm_messages import framed
from services.gnss_receiver.stream_frames import Frame, Framer
from tests.unit.gnss_receiver.stream_samples import nmea, ubx

RTCM = framed(bytes(range(40)))
UBX = ubx(b"\x0a\x04", b"\xd3\x00\x05$abc")
NMEA = nmea("GNTXT,01,01,02,hello")
FRAMES = [
    Frame("rtcm3", bytes(range(40))),
    Frame("ubx", b"\x0a\x04\xd3\x00\x05$abc"),
    Frame("nmea", b"GNTXT,01,01,02,hello"),
]
STREAM = RTCM + UBX + NMEA


def frames_in(stream: bytes, *cuts: int) -> tuple[list[Frame], Framer]:
    framer = Framer()
    bounds = [0, *cuts, len(stream)]
    return [frame for start, stop in pairwise(bounds) for frame in framer.feed(stream[start:stop])], framer


@pytest.mark.parametrize("cut", range(len(STREAM)))
def test_a_cut_anywhere_changes_nothing(cut: int) -> None:
    found, framer = frames_in(STREAM, cut)
    assert found == FRAMES
    assert framer.counts["bytes_skipped"] == 0
    assert framer.counts["bytes"] == len(STREAM)


def test_byte_by_byte() -> None:
    assert frames_in(STREAM, *range(1, len(STREAM)))[0] == FRAMES


@pytest.mark.parametrize("start", range(len(RTCM + UBX)))
def test_who_joins_in_the_middle_gets_the_next_whole_frame(start: int) -> None:
    found, framer = frames_in(STREAM[start:])
    assert found == (FRAMES if start == 0 else FRAMES[1:] if start <= len(RTCM) else FRAMES[2:])
    whole = {0: 0, len(RTCM): 0}.get(start)
    if whole is None:
        assert framer.counts["bytes_skipped"] == (len(RTCM) if start < len(RTCM) else len(RTCM + UBX)) - start


@pytest.mark.parametrize("place", range(len(RTCM)))
def test_a_damaged_frame_costs_only_itself(place: int) -> None:
    damaged = bytearray(RTCM)
    damaged[place] ^= 0x10
    # A damaged length may claim the whole of what follows, so something must follow.
    found, framer = frames_in(bytes(damaged) + STREAM + bytes(1100))
    assert found == FRAMES
    assert framer.counts["rtcm3_crc_errors"] == (place not in (0, 1))


@pytest.mark.parametrize(
    ("stream", "counter"),
    [
        (UBX[:-1] + b"\xff", "ubx_checksum_errors"),
        (NMEA.replace(b"hello", b"hallo"), "nmea_checksum_errors"),
        (RTCM[:-1] + b"\xff", "rtcm3_crc_errors"),
    ],
)
def test_wrong_checks_are_counted(stream: bytes, counter: str) -> None:
    found, framer = frames_in(stream + b"\0" * 64)
    assert found == []
    assert framer.counts[counter] == 1


@given(st.binary(max_size=200).filter(lambda noise: not re.search(rb"[\xd3\xb5$]", noise)))
def test_noise_between_frames_is_skipped_and_counted(noise: bytes) -> None:
    found, framer = frames_in(noise + RTCM + noise + UBX + noise + NMEA + noise)
    assert found == FRAMES
    assert framer.counts["bytes_skipped"] == 4 * len(noise)


@given(st.binary(max_size=3000), st.integers(1, 400))
def test_no_bytes_make_it_fail_and_every_byte_is_accounted_for(noise: bytes, chunk: int) -> None:
    framer = Framer()
    taken = 0
    for at in range(0, len(noise), chunk):
        for frame in framer.feed(noise[at : at + chunk]):
            taken += len(frame.content) + {"rtcm3": 6, "ubx": 6, "nmea": 5}[frame.protocol]
    framer.cut()
    assert framer.counts["bytes"] == len(noise)
    # A sentence may end with LF alone, which is one byte less.
    assert 0 <= taken + framer.counts["bytes_skipped"] - len(noise) <= framer.counts["nmea_frames"]


def test_a_frame_inside_one_that_fails_its_check_is_found() -> None:
    # A preamble in noise claims 40 bytes, in which a real frame stands.
    inner = framed(b"\x40\x50")
    false = b"\xd3\x00\x28" + inner + b"\0" * 40
    assert frames_in(false)[0] == [Frame("rtcm3", b"\x40\x50")]


def test_lengths_that_cannot_be_are_not_waited_for() -> None:
    # A UBX length of 65535 and an endless sentence would otherwise hold back everything behind them.
    found, _ = frames_in(b"\xb5\x62\x01\x07\xff\xff" + b"$" + b"A" * 400 + RTCM)
    assert found == FRAMES[:1]


def test_an_empty_message_and_the_longest_are_frames() -> None:
    longest = bytes(index % 251 for index in range(1023))
    assert [frame.content for frame in frames_in(framed(b"") + framed(longest))[0]] == [b"", longest]
    with pytest.raises(ValueError, match="1024 bytes does not fit"):
        framed(bytes(1024))


def test_a_cut_connection_leaves_nothing_behind() -> None:
    framer = Framer()
    assert framer.feed(RTCM[:20]) == []
    framer.cut()
    assert framer.counts["bytes_skipped"] == 20
    # The rest of the old frame, had it come, is noise now.
    assert framer.feed(RTCM[20:] + RTCM) == FRAMES[:1]


def test_known_frames() -> None:
    # RTCM 10403.3, 4.2: a message 1005 with its check 0x360b98.
    frame = bytes.fromhex("d300133ed7d30202980edeef34b4bd62ac0941986f33360b98")
    assert crc24q(frame) == 0
    assert [one.content for one in frames_in(frame)[0]] == [frame[3:-3]]
