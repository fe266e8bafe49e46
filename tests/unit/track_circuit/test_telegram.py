from __future__ import annotations

import zlib
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.track_circuit.crc import bits_of, bytes_of, crc32c, undetected_per_hour
from services.track_circuit.profile import Framing
from services.track_circuit.telegram import Frame, TelegramScanner, shortest_bits, telegram_bits
from services.track_circuit.telegram_acceptance import FORGET_S, Acceptance

FRAMING = Framing()


def scanned(bits: np.ndarray, piece: int) -> list[Frame]:
    scanner = TelegramScanner(FRAMING)
    found = [f for at in range(0, len(bits), piece) for f in scanner.take(bits[at : at + piece], at)]
    return found + scanner.finish()


def test_the_check_is_the_published_one_and_not_the_ethernet_one() -> None:
    assert crc32c(b"123456789") == 0xE3069283
    assert crc32c(b"123456789") != zlib.crc32(b"123456789")


def test_no_error_of_up_to_five_bits_passes_in_the_longest_telegram() -> None:
    message = bytes(5 + FRAMING.longest_payload + 4)
    base = crc32c(message[:-4])
    # Effect of each wrong bit on the check; linear, so patterns are sums. Wrong bits of the check itself are units.
    single = [crc32c(bytes_of(row)) ^ base for row in np.eye(8 * (len(message) - 4), dtype=np.int8)]
    single += [1 << k for k in range(32)]
    pairs = [a ^ b for a, b in combinations(single, 2)]
    assert len(set(pairs) | set(single) | {0}) == len(pairs) + len(single) + 1  # no 1, 2, 3 or 4 wrong bits
    # The generator has the factor x + 1: an odd number of wrong bits always shows, five as well.
    assert all(effect.bit_count() % 2 == 1 for effect in single)


@settings(max_examples=40)
@given(st.integers(0, 65535), st.integers(0, 65535), st.binary(max_size=64), st.integers(1, 300))
def test_telegrams_come_back_whatever_the_pieces(circuit: int, sequence: int, payload: bytes, piece: int) -> None:
    noise = np.random.default_rng(0).integers(0, 2, 37).astype(np.int8)
    one = telegram_bits(circuit, sequence, payload, FRAMING)
    good = [f for f in scanned(np.concatenate([noise, one, one, noise]), piece) if f.crc_ok]
    assert [(f.symbol, f.circuit_id, f.sequence, f.payload) for f in good] == [
        (37, circuit, sequence, payload),
        (37 + len(one), circuit, sequence, payload),
    ]


@pytest.mark.parametrize("wrong", [13, 40, 60, 100])
def test_a_wrong_bit_gives_a_failed_telegram_without_claims(wrong: int) -> None:
    bits = np.concatenate([telegram_bits(7, 1, b"speed", FRAMING), np.zeros(200, np.int8)])
    bits[wrong] ^= 1
    found = scanned(bits, 50)
    assert found
    assert found[0].symbol == 0
    assert not found[0].crc_ok
    assert found[0].circuit_id is None
    assert found[0].payload == b""


def test_one_wrong_bit_in_the_preamble_is_forgiven() -> None:
    bits = telegram_bits(7, 1, b"speed", FRAMING)
    bits[3] ^= 1
    assert [f.crc_ok for f in scanned(bits, 500)] == [True]


def test_a_gap_drops_the_telegram_that_it_cuts() -> None:
    bits = telegram_bits(7, 1, b"speed", FRAMING)
    scanner = TelegramScanner(FRAMING)
    assert scanner.take(bits[:60], 0) == []
    assert scanner.take(bits[60:], 61) == []


@pytest.mark.parametrize(("circuit", "payload"), [(70_000, b""), (-1, b""), (1, bytes(65))])
def test_what_does_not_fit_is_refused(circuit: int, payload: bytes) -> None:
    with pytest.raises(ValueError, match=r"16 bits|longer"):
        telegram_bits(circuit, 0, payload, FRAMING)


def frame(sequence: int, payload: bytes = b"go", *, circuit: int = 7, ok: bool = True) -> Frame:
    return Frame(0, 100, ok, circuit if ok else None, sequence if ok else None, payload if ok else b"")


def test_two_in_a_row_are_good_and_replays_are_not() -> None:
    judge = Acceptance(7, 2)
    states = [judge.judge(f, t) for t, f in enumerate([frame(5), frame(6), frame(6), frame(5), frame(7)])]
    assert states == ["unconfirmed", "good", "repeated", "old", "good"]


def test_a_changed_payload_a_failure_and_a_stranger_have_to_be_confirmed_anew() -> None:
    judge = Acceptance(7, 2)
    frames = [frame(1), frame(2), frame(3, b"stop"), frame(4, b"stop"), frame(0, ok=False), frame(5, b"stop")]
    frames += [frame(6, b"stop"), frame(7, circuit=8), frame(8, b"stop")]
    assert [judge.judge(f, t) for t, f in enumerate(frames)] == [
        "unconfirmed",
        "good",
        "unconfirmed",
        "good",
        "bad_crc",
        "unconfirmed",
        "good",
        "other_circuit",
        "unconfirmed",
    ]


def test_sequence_numbers_wrap_and_are_forgotten_after_silence() -> None:
    judge = Acceptance(None, 2)
    assert [judge.judge(frame(n), 0.0) for n in (65535, 0)] == ["unconfirmed", "good"]
    assert judge.judge(frame(65000), 1.0) == "old"
    assert judge.judge(frame(65000), FORGET_S + 1.0) == "unconfirmed"


def test_the_calculated_rate_meets_the_target_with_two_confirmations_alone() -> None:
    shortest = shortest_bits(FRAMING)
    assert shortest == 13 + 72
    assert undetected_per_hour(300.0, shortest, 1) == pytest.approx(3600 * 300 / 85 / 2**32)
    assert undetected_per_hour(300.0, shortest, 1) > 1e-9
    assert undetected_per_hour(300.0, shortest, 2) < 1e-9


def test_bits_and_bytes_are_inverse() -> None:
    assert bytes_of(bits_of(bytes(range(256)))) == bytes(range(256))
