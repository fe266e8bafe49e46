"""Gaps, repetitions, restarts and twins from sequence numbers."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from services.runtime.sequence import Mark, SequenceTracker


def marks(*arrivals: tuple[str, int]) -> tuple[list[str], SequenceTracker]:
    tracker = SequenceTracker()
    return [tracker.take(boot_id, sequence).value for boot_id, sequence in arrivals], tracker


def test_a_reader_may_join_late() -> None:
    said, tracker = marks(("a", 7), ("a", 8))
    assert said == ["first", "next"]
    assert (tracker.received, tracker.missing) == (2, 0)


def test_a_gap_counts_what_it_left_out() -> None:
    said, tracker = marks(("a", 0), ("a", 4), ("a", 5))
    assert said == ["first", "gap", "next"]
    assert tracker.missing == 3


def test_repetitions_and_the_overtaken_are_duplicates() -> None:
    said, tracker = marks(("a", 0), ("a", 2), ("a", 2), ("a", 1))
    assert said == ["first", "gap", "duplicate", "duplicate"]
    assert (tracker.received, tracker.duplicated) == (2, 2)


def test_a_restart_counts_from_zero_and_misses_what_came_before() -> None:
    said, tracker = marks(("a", 0), ("a", 1), ("b", 0), ("c", 2))
    assert said == ["first", "next", "restart", "restart"]
    assert (tracker.restarts, tracker.missing) == (2, 2)


def test_a_late_message_of_the_start_before_is_a_duplicate() -> None:
    said, tracker = marks(("a", 5), ("b", 0), ("a", 5), ("a", 4), ("b", 1))
    assert said == ["first", "restart", "duplicate", "duplicate", "next"]
    assert tracker.duplicated == 2


def test_two_senders_under_one_name_are_twins() -> None:
    said, tracker = marks(("a", 0), ("b", 0), ("a", 1), ("b", 1))
    assert said == ["first", "restart", "twin", "twin"]
    assert tracker.twins == 2


def test_only_the_last_sixteen_starts_are_remembered() -> None:
    tracker = SequenceTracker()
    for number in range(18):
        tracker.take(f"boot {number}", 0)
    assert len(tracker.past_boots) == 16
    # The very first start is forgotten: that it speaks again looks like one more restart.
    assert tracker.take("boot 0", 1) is Mark.RESTART


@given(st.lists(st.integers(0, 40), min_size=1, max_size=60))
def test_received_and_missing_make_up_the_span(sequence: list[int]) -> None:
    """From the first number to the newest, each was received once, or is missing."""
    tracker = SequenceTracker()
    handed_on = [number for number in sequence if tracker.take("a", number) is not Mark.DUPLICATE]
    assert handed_on == sorted(set(handed_on))
    assert tracker.received + tracker.missing == tracker.newest - handed_on[0] + 1
    assert tracker.received + tracker.duplicated == len(sequence)


@given(st.integers(0, 1000), st.sets(st.integers(0, 99)))
def test_what_is_left_out_is_counted_exactly(start: int, lost: set[int]) -> None:
    tracker = SequenceTracker()
    sent = [number for number in range(100) if number not in lost]
    for number in sent:
        tracker.take("a", start + number)
    if sent:
        assert tracker.missing == len([number for number in lost if sent[0] < number < sent[-1]])
