"""The spool against a model: what it acknowledged is there, in order, until it is let go of or dropped and counted."""

from __future__ import annotations

import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.bridge import BridgedRecord
from services.lte_bridge.batch import unpacked
from services.lte_bridge.lane import LANES, Lane
from services.lte_bridge.spool_store import Spool, SpoolFaultError, SpoolInUseError
from tests.unit.lte_bridge.records import BULK_KEY, EVENT_KEY, QUICK_DISK, noise, record

AMPLE = 100_000_000
KEYS: dict[Lane, str] = {"events": EVENT_KEY, "bulk": BULK_KEY}


@contextmanager
def opened(folder: Path, cap_bytes: int = AMPLE) -> Iterator[Spool]:
    spool = Spool(folder, cap_bytes)
    spool.open()
    try:
        yield spool
    finally:
        spool.close()


def drained(spool: Spool, lane: Lane, most_bytes: int = 4096) -> list[BridgedRecord]:
    """Everything of a lane, acknowledged batch by batch."""
    found: list[BridgedRecord] = []
    while (cut := spool.cut(lane, most_bytes)) is not None:
        found += unpacked(cut.compressed, cut.count)
        assert spool.acknowledge(lane, cut.last) == cut.count
    return found


@settings(max_examples=25)  # every step waits for the disk
@given(
    steps=st.lists(
        st.one_of(
            st.tuples(st.just("put"), st.sampled_from(LANES), st.integers(1, 80)),
            st.tuples(st.just("again"), st.sampled_from(LANES), st.integers(1, 80)),
            st.tuples(st.just("send"), st.sampled_from(LANES), st.integers(50, 4000)),
            st.tuples(st.just("part"), st.sampled_from(LANES), st.integers(50, 4000)),
            st.tuples(st.just("kill"), st.sampled_from(LANES), st.just(0)),
        ),
        max_size=40,
    )
)
def test_what_was_put_comes_out_once_and_in_order(steps: list[tuple[str, Lane, int]]) -> None:
    put: dict[Lane, list[BridgedRecord]] = {lane: [] for lane in LANES}
    sent: dict[Lane, list[BridgedRecord]] = {lane: [] for lane in LANES}
    with tempfile.TemporaryDirectory(dir=QUICK_DISK) as name:
        spool = Spool(Path(name), AMPLE)
        spool.open()
        spool_id = spool.spool_id
        for what, lane, amount in steps:
            if what == "put":
                fresh = [record(len(put[lane]) + n, KEYS[lane]) for n in range(amount)]
                assert spool.put(fresh) == amount
                put[lane] += fresh
            elif what == "again":  # as the bus does after a restart
                assert spool.put(put[lane][-amount:]) == 0
            elif what == "kill":
                spool.close()
                spool = Spool(Path(name), AMPLE)
                spool.open()
                assert spool.spool_id == spool_id
            elif (cut := spool.cut(lane, amount)) is not None:
                assert cut.first == len(sent[lane])
                records = unpacked(cut.compressed, cut.count)
                assert cut.newest_ns == records[-1].heard_ns
                taken = records if what == "send" else records[: (len(records) + 1) // 2]
                assert spool.acknowledge(lane, cut.first + len(taken) - 1) == len(taken)
                sent[lane] += taken
            held = spool.held()
            for one in LANES:
                assert held.lanes[one].records == len(put[one]) - len(sent[one])
                assert sent[one] == put[one][: len(sent[one])]
        for lane in LANES:
            assert sent[lane] + drained(spool, lane) == put[lane]
        assert (spool.held().bytes, spool.held().records, spool.held().oldest_ns) == (0, 0, None)
        spool.close()


@settings(max_examples=15)
@given(st.lists(st.tuples(st.sampled_from(LANES), st.integers(200, 3000), st.booleans()), max_size=40))
def test_the_cap_is_kept_the_oldest_bulk_goes_first_and_every_drop_counts(puts: list[tuple[Lane, int, bool]]) -> None:
    cap = 12_000
    number: dict[Lane, int] = dict.fromkeys(LANES, 0)
    kept_events: list[BridgedRecord] = []
    with tempfile.TemporaryDirectory(dir=QUICK_DISK) as name:
        spool = Spool(Path(name), cap)
        spool.open()
        for lane, size, kill in puts:
            one = record(number[lane], KEYS[lane], payload=noise(size))
            number[lane] += 1
            refused = spool.held().lanes["events"].dropped
            spool.put([one])
            held = spool.held()
            assert held.bytes <= cap
            if lane == "events":
                if held.lanes["events"].dropped == refused:
                    kept_events.append(one)
                    assert not held.full_of_events
                else:
                    assert held.full_of_events
                    assert held.lanes["bulk"].records == 0, "events are refused while there is bulk to be dropped"
            if kill:
                spool.close()
                spool = Spool(Path(name), cap)
                spool.open()
                assert spool.held().lanes == held.lanes
        dropped = {lane: spool.held().lanes[lane].dropped for lane in LANES}
        bulk = drained(spool, "bulk")
        assert drained(spool, "events") == kept_events
        assert len(kept_events) + dropped["events"] == number["events"]
        assert len(bulk) + dropped["bulk"] == number["bulk"]
        numbers = [one.heard_ns for one in bulk]
        assert numbers == sorted(numbers)
        spool.close()


def test_small_batches_become_few_and_take_less_room(tmp_path: Path) -> None:
    with opened(tmp_path) as spool:
        everything = [record(number) for number in range(330)]
        spool.put(everything[:1])
        alone = spool.held().bytes
        for one in everything[1:]:
            spool.put([one])
        assert spool.held().bytes < 0.3 * alone * len(everything)
        count = sqlite3.connect(spool.path).execute("SELECT count(*) FROM batch").fetchone()[0]
        assert count == 330 // 32 + 330 % 32
        assert drained(spool, "bulk") == everything


def test_a_batch_that_took_over_the_id_of_another_lanes_is_not_folded_into_that(tmp_path: Path) -> None:
    with opened(tmp_path) as spool:
        bulk = [record(number) for number in range(40)]
        event = record(0, EVENT_KEY)
        spool.put(bulk[:1])
        spool.acknowledge("bulk", 0)
        spool.put([event])  # number 0, as the bulk that has gone was, and in its row
        for one in bulk[1:]:
            spool.put([one])
        assert drained(spool, "events") == [event]
        assert drained(spool, "bulk") == bulk[1:]


def test_a_batch_is_about_as_large_as_asked_for(tmp_path: Path) -> None:
    with opened(tmp_path) as spool:
        everything = [record(number, payload=noise(300, number)) for number in range(3000)]
        spool.put(everything)
        sizes = []
        found: list[BridgedRecord] = []
        while (cut := spool.cut("bulk", 20_000)) is not None:
            sizes.append(len(cut.compressed))
            found += unpacked(cut.compressed, cut.count)
            spool.acknowledge("bulk", cut.last)
        assert found == everything
        assert max(sizes) <= 40_000
        assert sum(sizes) / len(sizes) > 15_000
        spool.put([record(5000, payload=noise(400_000))])
        cut = spool.cut("bulk", 20_000)
        assert cut is not None
        assert cut.count == 1  # larger than asked for, but it goes


def test_a_record_that_fits_into_no_batch_is_dropped_and_told(tmp_path: Path) -> None:
    with opened(tmp_path) as spool:
        spool.put([record(0, payload=bytes(1_040_000)), record(1)])
        assert spool.held().lanes["bulk"].dropped == 1
        assert "too large" in spool.notes[0]
        assert drained(spool, "bulk") == [record(1)]


def test_a_spool_restored_from_a_copy_goes_on_under_a_new_id(tmp_path: Path) -> None:
    with opened(tmp_path) as spool:
        spool.put([record(0)])
        before = spool.spool_id
        assert spool.acknowledge("bulk", 7) == 0
        assert spool.spool_id != before
        assert "new id" in spool.notes[0]
        assert drained(spool, "bulk") == [record(0)]


def test_one_bridge_at_a_time(tmp_path: Path) -> None:
    with opened(tmp_path), pytest.raises(SpoolInUseError, match="another bridge uses"):
        Spool(tmp_path, AMPLE).open()


def test_a_closed_spool_stays_closed(tmp_path: Path) -> None:
    with opened(tmp_path) as spool:
        pass
    with pytest.raises(SpoolFaultError, match="closed"):
        spool.put([record(0)])


def test_drops_before_the_spool_are_counted_with_its_own(tmp_path: Path) -> None:
    with opened(tmp_path) as spool:
        spool.put([record(0)], {"bulk": 3, "events": 1})
    with opened(tmp_path) as spool:
        assert [spool.dropped(lane) for lane in LANES] == [1, 3]


def test_free_pages_are_given_back_a_little_at_a_time(tmp_path: Path) -> None:
    with opened(tmp_path) as spool:
        for number in range(60):
            spool.put([record(number, payload=noise(500_000))])
        drained(spool, "bulk", 500_000)
        full = spool.path.stat().st_size
        for _ in range(40):
            spool.tidy()
        spool.put([record(100)])
    assert spool.path.stat().st_size < 0.7 * full
