"""Nothing is taken twice, and nothing new is turned away."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from schemas.bridge import BridgedRecord
from services.lte_bridge.deduplication import MOST_SPANS, Deduplication, Judgement, Spans, StateRow
from tests.unit.lte_bridge.records import BULK_KEY, EVENT_KEY, batch, record


@given(st.lists(st.integers(0, 60), max_size=120))
def test_spans_know_exactly_what_was_added(numbers: list[int]) -> None:
    spans, model = Spans(), set[int]()
    for number in numbers:
        assert spans.add(number) == (number not in model)
        model.add(number)
    had = [n for first, last in zip(spans.firsts, spans.lasts, strict=True) for n in range(first, last + 1)]
    assert had == sorted(model)


def test_spans_are_bounded_by_giving_up_the_oldest_gap() -> None:
    spans = Spans()
    for number in range(0, 4 * MOST_SPANS, 2):
        assert spans.add(number)
    assert len(spans.firsts) == MOST_SPANS
    assert not spans.add(1)  # in the gap that was given up
    assert spans.add(4 * MOST_SPANS - 3)  # in a gap still known


def keep(memory: Deduplication, judgement: Judgement, table: dict[str, StateRow]) -> list[BridgedRecord]:
    """What a store does: commit, then apply."""
    table.update({row.name: row for row in judgement.rows})
    for name in judgement.forgotten:
        del table[name]
    memory.apply(judgement)
    return list(judgement.fresh)


@given(
    cuts=st.lists(st.tuples(st.integers(1, 30), st.booleans(), st.booleans()), max_size=40),
    restarts=st.sets(st.integers(0, 39)),
)
def test_whatever_is_sent_again_and_however_cut_arrives_once_and_in_order(
    cuts: list[tuple[int, bool, bool]], restarts: set[int]
) -> None:
    everything = [record(number) for number in range(200)]
    memory, table, had = Deduplication(), dict[str, StateRow](), list[BridgedRecord]()
    acknowledged = 0
    for step, (count, commits, answered) in enumerate(cuts):
        if step in restarts:
            memory = Deduplication()
            memory.restore(table.values())
        sent = everything[acknowledged : acknowledged + count]
        if not sent:
            break
        judgement = memory.judge(batch(acknowledged, sent), sent)
        if not commits:
            continue
        had += keep(memory, judgement, table)
        assert had == everything[: len(had)]
        assert judgement.through == len(had) - 1
        if answered:
            acknowledged = judgement.through + 1
            assert acknowledged <= len(had)


def test_a_new_spool_that_holds_old_records_brings_nothing_twice() -> None:
    memory, table = Deduplication(), dict[str, StateRow]()
    first = [record(number) for number in range(10)]
    assert keep(memory, memory.judge(batch(0, first), first), table) == first
    rescued = [record(number) for number in range(5, 15)]
    judgement = memory.judge(batch(0, rescued, spool_id="s2"), rescued)
    assert keep(memory, judgement, table) == rescued[5:]
    assert (judgement.repeated, judgement.through) == (5, 9)


def test_a_number_says_what_is_a_repetition_where_the_sender_set_no_mark() -> None:
    memory, table = Deduplication(), dict[str, StateRow]()
    foreign = [BridgedRecord(key=BULK_KEY, payload=b"x", attachment=b"", heard_ns=1) for _ in range(4)]
    keep(memory, memory.judge(batch(0, foreign[:3]), foreign[:3]), table)
    judgement = memory.judge(batch(1, foreign[:3]), foreign[:3])
    assert (len(judgement.fresh), judgement.repeated, judgement.through) == (1, 2, 3)


def test_a_batch_behind_what_is_had_says_how_far_that_is() -> None:
    memory, table = Deduplication(), dict[str, StateRow]()
    sent = [record(number) for number in range(10)]
    keep(memory, memory.judge(batch(0, sent), sent), table)
    again = memory.judge(batch(0, sent[:4]), sent[:4])
    assert (again.fresh, again.repeated, again.through) == ((), 4, 9)


def test_numbers_dropped_by_the_sender_are_passed_over() -> None:
    memory, table = Deduplication(), dict[str, StateRow]()
    keep(memory, memory.judge(batch(0, [record(0)]), [record(0)]), table)
    judgement = memory.judge(batch(50, [record(50)]), [record(50)])
    assert (len(judgement.fresh), judgement.through) == (1, 50)


def test_boots_and_keys_are_told_apart() -> None:
    memory = Deduplication()
    heard = [record(0), record(0, boot="b2"), record(0, key=EVENT_KEY), record(0)]
    judgement = memory.judge_heard(heard)
    assert list(judgement.fresh) == heard[:3]


def test_what_is_not_applied_is_not_remembered() -> None:
    memory = Deduplication()
    sent = [record(0)]
    assert memory.judge(batch(0, sent), sent).fresh == memory.judge(batch(0, sent), sent).fresh == tuple(sent)


def test_the_least_recently_used_is_forgotten_also_after_a_restart() -> None:
    memory, table = Deduplication(most_streams=3), dict[str, StateRow]()
    for boot in ("b1", "b2", "b3", "b1"):
        heard = [record(len(table), boot=boot)]
        keep(memory, memory.judge_heard(heard), table)
    memory = Deduplication(most_streams=3)
    memory.restore(table.values())
    judgement = memory.judge_heard([record(0, boot="b4")])
    assert [name.split("\n")[2] for name in judgement.forgotten] == ["b2"]
    keep(memory, judgement, table)
    assert len(table) == 3


def test_a_state_that_is_none_is_left_out() -> None:
    memory = Deduplication()
    memory.restore([StateRow("x", b"\xff", 1), StateRow("y", b"\x93\x01\x02\x03", 2)])
    assert memory.judge_heard([record(0)]).fresh
