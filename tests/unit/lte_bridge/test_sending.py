"""How much, when, and in whose turn; and what is told about it."""

from __future__ import annotations

import random

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.bridge import BridgedRecord
from services.lte_bridge.exchange import Turns, acknowledgement_of, fault_of
from services.lte_bridge.filling import WINDOW_S, Filling
from services.lte_bridge.introduction import FOUND_S, Introductions
from services.lte_bridge.lane import LANES, Lane
from services.lte_bridge.pace import LEAST_BATCH_BYTES, MOST_BATCH_BYTES, MOST_TIMEOUT_S, Meter, Pace, paces
from services.lte_bridge.pending import Pending
from services.lte_bridge.settings import Settings
from services.lte_bridge.spool_table_store import LaneTotals
from services.lte_bridge.telling import DROPPED_SHOWN_S, LINKED_S, Held, Progress
from tests.unit.lte_bridge.records import EVENT_KEY, batch, record


def pace() -> Pace:
    return Pace(aim_s=0.4, timeout_s=5.0, first_wait_s=0.25, most_wait_s=5.0, rng=random.Random(1))  # noqa: S311 - no secret


@given(bytes_per_s=st.floats(6e3, 1e6), delay_s=st.floats(0.0, 0.05))
def test_a_batch_comes_to_take_the_link_as_long_as_it_should(bytes_per_s: float, delay_s: float) -> None:
    one = pace()
    for _ in range(30):
        one.acknowledged(one.batch_bytes, delay_s + one.batch_bytes / bytes_per_s)
    took_s = delay_s + one.batch_bytes / bytes_per_s
    # Either it takes the link so long (to a byte and what the delay's share still moves), or it is as large as may be.
    assert took_s == pytest.approx(0.4, rel=0.02) or (one.batch_bytes == MOST_BATCH_BYTES and took_s < 0.4)


def test_a_batch_never_grows_to_more_than_double() -> None:
    one = pace()
    before = one.batch_bytes
    one.acknowledged(before, 0.001)
    assert one.batch_bytes == 2 * before
    one.acknowledged(100, 0.001)  # a trickle tells nothing about large batches
    assert one.batch_bytes == 2 * before


def test_without_answer_batches_shrink_patience_grows_and_pauses_double() -> None:
    one = pace()
    pauses = [one.unanswered(20.0) for _ in range(8)]
    for pause, whole in zip(pauses, [0.25, 0.5, 1.0, 2.0, 4.0, 5.0, 5.0, 5.0], strict=True):
        assert whole / 2 <= pause <= whole
    assert one.batch_bytes == LEAST_BATCH_BYTES
    assert one.patience_s == MOST_TIMEOUT_S
    one.acknowledged(2048, 0.1)
    assert (one.failures, one.patience_s) == (0, 5.0)
    size = one.batch_bytes
    one.unanswered(0.1)
    assert (one.batch_bytes, one.patience_s) == (size, 5.0), "nobody was there"
    one.unanswered(5.0)
    one.acknowledged(2048, 4.0)
    assert one.patience_s == 10.0, "a link that takes seconds keeps the patience that it needs"


def test_a_refusal_changes_neither_size_nor_patience() -> None:
    one = pace()
    before = (one.batch_bytes, one.patience_s)
    assert 0.125 <= one.refused() <= 0.25
    assert (one.batch_bytes, one.patience_s) == before


def test_pauses_are_the_same_for_the_same_bridge_and_others_for_another() -> None:
    settings = Settings(receives=True)
    first, again, other = (paces(settings, seed)["bulk"].refused() for seed in ("T1", "T1", "T2"))
    assert first == again != other


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(1, 50_000)), min_size=1, max_size=50))
def test_the_meter_keeps_the_rate_from_the_second_batch_on(batches: list[tuple[float, int]]) -> None:
    meter, now_s, sent = Meter(100_000.0), 0.0, 0
    for idle_s, size in batches:
        now_s += idle_s + meter.wait_s(now_s + idle_s)
        assert 8 * sent <= 100_000.0 * now_s + 1e-3  # rounding of a sum of times
        meter.sent(size, now_s)
        sent += size
    assert Meter(None).wait_s(1.0) == 0.0


def test_bulk_waits_while_an_event_waits_to_be_taken_along() -> None:
    turns = Turns()
    both: dict[Lane, int] = {"events": 2, "bulk": 9}
    newest: dict[Lane, int] = {"events": 5, "bulk": 20}
    assert turns.may_go("events", both, newest)
    assert not turns.may_go("bulk", both, newest)
    turns.goes("events", 5)
    assert turns.may_go("bulk", both, newest), "what is on its way holds up nothing"
    assert not turns.may_go("bulk", both, newest | {"events": 6})
    turns.pauses("events", pausing=True)
    assert turns.may_go("bulk", both, newest), "nor does what cannot go"
    turns.pauses("events", pausing=False)
    assert not turns.may_go("bulk", both, newest)
    assert turns.may_go("bulk", {"events": 0, "bulk": 1}, newest)
    assert not turns.may_go("events", {"events": 0, "bulk": 1}, newest)


def test_only_an_answer_to_the_batch_itself_acknowledges_it() -> None:
    sent = batch(10, [record(10), record(11)])
    answer = acknowledgement_of(sent, 11, 0, 0, 7)
    assert fault_of(sent, answer) is None
    for wrong in ({"spool_id": "x"}, {"lane": "events"}, {"bridge": "x"}):
        assert "not what was sent" in (fault_of(sent, msgspec.structs.replace(answer, **wrong)) or "")
    assert "up to 9" in (fault_of(sent, msgspec.structs.replace(answer, through=9)) or "")


def test_what_follows_the_first_word_on_a_key_waits_until_its_readers_have_found_it() -> None:
    introductions = Introductions()
    introductions.said("old", 0.0)
    heard = [record(n, key) for n, key in enumerate(["old", "a", "old", "a", "b", "b", "a"])]
    order = introductions.order(heard)
    assert [(one.key, one.heard_ns % 10) for one in order] == [
        *[("a", 1), ("b", 4)],
        *[("old", 0), ("old", 2), ("a", 3), ("b", 5), ("a", 6)],
    ]
    assert introductions.wait_s("a", 10.0) == 0.0
    introductions.said("a", 10.0)
    introductions.said("a", 11.0)
    assert introductions.wait_s("a", 11.0) == pytest.approx(FOUND_S - 1.0)
    assert introductions.wait_s("a", 12.0) == introductions.wait_s("b", 12.0) == 0.0
    introductions.said("b", 12.0)
    assert introductions.order(heard) == heard


def test_the_time_until_full_is_that_of_the_last_hour() -> None:
    filling = Filling()
    for minute in range(180):
        # Fast for most of two hours, then a byte a second.
        filling.note(60.0 * minute, 10**6 * min(minute, 110) + 60 * max(0, minute - 110))
    now_s, held = 60.0 * 179, 10**6 * 110 + 60 * 69
    # The window begins within a step of an hour ago.
    assert filling.full_in_s(now_s, held, held + 3600) == pytest.approx(WINDOW_S, rel=0.02)
    assert filling.full_in_s(now_s, 10**6, 10**9) is None, "it empties"
    assert Filling().full_in_s(0.0, 1, 2) is None


def test_memory_is_bounded_and_keeps_room_for_events() -> None:
    pending = Pending(10_000)
    bulk = [BridgedRecord(key="k", payload=bytes(700), attachment=b"", heard_ns=0) for _ in range(10)]
    assert [pending.add("bulk", one) for one in bulk] == 8 * [True] + 2 * [False]
    assert [pending.add("events", one) for one in bulk[:3]] == [True, True, False]
    assert pending.dropped == {"events": 1, "bulk": 2}
    pending.taken(10, {"events": 1, "bulk": 2})
    assert pending.dropped == {"events": 0, "bulk": 0}
    assert pending.add("bulk", record(0, EVENT_KEY))


def held(records: int, *, full: bool = False, dropped: int = 0) -> Held:
    lanes = {lane: LaneTotals(records=records, bytes=100 * records, dropped=dropped) for lane in LANES}
    return Held(lanes, None, 0, 1000, full)


def test_reasons_are_given_in_words_and_taken_back() -> None:
    progress = Progress(linked_s=0.0)
    told = progress.status(held(0), dict.fromkeys(LANES, 0), 1, 100.0)
    assert told.linked
    assert set(progress.reasons(held(0), told, 100.0).values()) == {None}
    progress.faults["bulk"] = "nobody answered at x"
    now_s = 100.0 + LINKED_S
    told = progress.status(held(3, full=True, dropped=2), {"events": 1, "bulk": 0}, 1, now_s)
    assert (told.linked, told.backlog_records, told.dropped_events, told.dropped_bulk) == (False, 6, 3, 2)
    reasons = progress.reasons(held(3, full=True, dropped=2), told, now_s)
    assert reasons["link"] == ("degraded", "6 records wait, none acknowledged for 10 s: nobody answered at x")
    assert reasons["full"] == ("failed", "the spool is full of events: 3 dropped so far")
    assert reasons["dropped"] == ("degraded", "dropping the oldest bulk: 2 since the spool was made")
    assert progress.reasons(held(3, dropped=2), told, now_s + DROPPED_SHOWN_S)["dropped"] is None
    progress.succeeded("bulk", 6, -1.0, now_s)
    assert (progress.acknowledged, progress.delays["bulk"], progress.faults) == (6, 0.0, {})
