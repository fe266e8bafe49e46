"""Publications in the order of their numbers, whatever comes in between."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.runtime import continuity as module
from services.runtime.attachment import Attachment, encode_attachment
from services.runtime.continuity import Continuity
from services.runtime.node import Sample

KEY = "kirotei/v1/demo/train/T1/slip"
SENDER = ("demo/train/T1/odometry", "boot")


def sample(number: int, boot_id: str = "boot") -> Sample:
    return Sample(KEY, b"%d" % number, encode_attachment(Attachment(SENDER[0], boot_id, number, 0)), 0)


def numbers(samples: object) -> list[int]:
    assert isinstance(samples, list | tuple)
    return [int(one.payload) for one in samples]


def beginning_at(newest: int, *, told: bool = True) -> Continuity:
    return Continuity(lambda _key, _source, _boot: newest, told=told)


def test_what_comes_in_its_turn_goes_on_at_once() -> None:
    follows = beginning_at(4)
    assert [numbers(follows.offer(sample(n))) for n in (5, 6, 7)] == [[5], [6], [7]]
    assert not follows.waiting


def test_what_comes_before_its_turn_waits() -> None:
    follows = beginning_at(4)
    assert [numbers(follows.offer(sample(n))) for n in (8, 9)] == [[], []]
    assert follows.open() == [SENDER]
    assert follows.gaps(SENDER) == {KEY: (5, 7)}
    assert [numbers(follows.offer(sample(n))) for n in (5, 6, 7)] == [[5], [6], [7, 8, 9]]
    assert (follows.open(), follows.missed) == ([], 0)


def test_what_nobody_keeps_is_given_up_and_counted() -> None:
    follows = beginning_at(4)
    follows.offer(sample(6))
    follows.offer(sample(9))
    assert numbers(follows.give_up(SENDER, KEY, 7)) == [6]
    assert (follows.gaps(SENDER), follows.missed) == ({KEY: (8, 8)}, 2)
    assert numbers(follows.offer(sample(8))) == [8, 9]


def test_a_gap_after_the_last_one_is_known_from_what_was_told() -> None:
    follows = beginning_at(4)
    follows.expect(SENDER, KEY, 4)
    assert not follows.waiting
    follows.expect(SENDER, KEY, 6)
    assert follows.gaps(SENDER) == {KEY: (5, 6)}
    assert [numbers(follows.offer(sample(n))) for n in (5, 6, 7)] == [[5], [6], [7]]
    assert not follows.waiting


def test_a_reader_that_was_never_there_before_has_missed_nothing() -> None:
    follows = beginning_at(-1, told=False)
    follows.offer(sample(10))
    assert follows.gaps(SENDER) == {KEY: (0, 9)}
    assert numbers(follows.give_up(SENDER, KEY, 9)) == [10]
    assert follows.missed == 0
    follows.offer(sample(12))
    follows.give_up(SENDER, KEY, 11)
    assert follows.missed == 1


def test_repetitions_foreigners_and_other_starts_pass() -> None:
    follows = beginning_at(4)
    assert numbers(follows.offer(sample(2))) == [2]
    assert len(follows.offer(Sample(KEY, b"7", b"no mark", 0))) == 1
    follows.offer(sample(7))
    assert numbers(follows.offer(sample(5, "another"))) == [5]
    assert follows.gaps(SENDER) == {KEY: (5, 6)}


def test_what_takes_too_much_room_is_fetched_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "HELD_BYTES", 3)
    follows = beginning_at(4)
    for number in (7, 8, 9):
        follows.offer(sample(number))
    assert follows.gaps(SENDER) == {KEY: (5, 6)}
    follows.offer(sample(10))
    assert follows.gaps(SENDER) == {KEY: (5, 10)}
    assert [numbers(follows.offer(sample(n))) for n in range(5, 11)] == [[n] for n in range(5, 11)]
    assert not follows.waiting


def test_everything_of_a_sender_can_be_given_up() -> None:
    follows = beginning_at(4)
    follows.offer(sample(6))
    follows.offer(sample(9))
    assert numbers(follows.give_up_all(SENDER)) == [6, 9]
    assert (follows.waiting, follows.missed) == (False, 3)


@given(st.lists(st.integers(0, 30), max_size=80), st.integers(-1, 10))
def test_each_goes_on_once_and_in_order_with_what_is_missing_filled_in(came: list[int], newest: int) -> None:
    follows = beginning_at(newest)
    passed: list[int] = []
    for number in came:
        passed += [one for one in numbers(follows.offer(sample(number))) if one > newest and one not in passed]
        if number % 3 == 0:
            for first, last in follows.gaps(SENDER).values():
                for missing in range(first, last + 1):
                    passed += numbers(follows.offer(sample(missing)))
    passed += numbers(follows.give_up_all(SENDER))
    assert passed == sorted(set(passed))
    assert {number for number in came if number > newest} <= set(passed)
