"""The embedded store: whole commits or none, days into files, pages, damage, old days."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import duckdb
import msgspec
import pytest

from schemas.bridge import StoreQuestion
from services.cloud_analyzer.duckdb_store import DATABASE, DuckDbStore
from services.cloud_analyzer.history import StoreError, StoreTimeoutError
from services.cloud_analyzer.ingest import Ingest, Taken
from tests.unit.cloud_analyzer.batches import DAY_NS, NOW_NS, STEP_NS, batch, measurement, service_event

DAY_OF_ROWS = DAY_NS // STEP_NS


@contextmanager
def opened(folder: Path, **settings: float) -> Iterator[tuple[DuckDbStore, Ingest]]:
    with closing(DuckDbStore(folder, **settings)) as store:  # type: ignore[arg-type]  # whole numbers where they are wanted
        yield store, Ingest("demo", store.had())


def take(store: DuckDbStore, ingest: Ingest, numbers: range, step: int = 1) -> Taken:
    brought = batch([measurement(n * step) for n in numbers], numbers.start, sent_ns=NOW_NS + 40 * DAY_NS)
    taken = ingest.take(brought, NOW_NS + 40 * DAY_NS)
    store.published(store.commit(taken.commit))
    ingest.confirm(taken)
    return taken


def powers(store: DuckDbStore, question: StoreQuestion) -> list[tuple[object, object]]:
    found: list[tuple[object, object]] = []
    while True:
        answer = store.ask(question, 10.0)
        assert len(answer.rows) <= question.limit
        at = [answer.columns.index(name) for name in ("sequence", "channel_power_dbm")]
        found += [(row[at[0]], row[at[1]]) for row in answer.rows]
        if not answer.next_page:
            return found
        question = msgspec.structs.replace(question, page=answer.next_page)


def test_pages_give_every_row_once_in_order_over_open_and_closed_days(tmp_path: Path) -> None:
    step = DAY_OF_ROWS // 50  # four days of 50 rows
    expected = [(n * step, -70.0 - n * step % 7) for n in range(200)]
    with opened(tmp_path) as (store, ingest):
        take(store, ingest, range(200), step)
        everything = StoreQuestion(t_ns=0, about="radio", limit=7)
        assert powers(store, everything) == expected
        told = store.tend(NOW_NS + 4 * DAY_NS)
        assert told.count("rows of radio") >= 2
        assert len(list(tmp_path.glob("raw/radio/day=*/*.parquet"))) == told.count("rows of radio")
        assert powers(store, everything) == expected
        assert store.tend(NOW_NS + 4 * DAY_NS) == ""
        # What comes late for a closed day goes into a second file of it.
        other = msgspec.structs.replace(measurement(1), key=measurement(1).key.replace("/r1/", "/r2/"))
        late = ingest.take(batch([service_event(1), other], 200, sent_ns=NOW_NS + 40 * DAY_NS), NOW_NS + 40 * DAY_NS)
        store.commit(late.commit)
        assert store.tend(NOW_NS + 4 * DAY_NS).count("000002.parquet") == 1
        assert len(powers(store, everything)) == 201
    with opened(tmp_path) as (store, _):
        assert len(powers(store, everything)) == 201
        from_ns, until_ns = NOW_NS + 20 * step * STEP_NS, NOW_NS + 30 * step * STEP_NS
        part = powers(store, StoreQuestion(t_ns=0, about="radio", limit=100, from_ns=from_ns, until_ns=until_ns))
        assert part == expected[20:30]


def test_a_batch_that_comes_again_is_known_after_a_restart(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, ingest):
        take(store, ingest, range(50))
    with opened(tmp_path) as (store, ingest):
        again = ingest.take(batch([measurement(n) for n in range(50)]), NOW_NS)
        assert (len(again.commit.rows), again.acknowledgement.repeated) == (0, 50)
        assert again.acknowledgement.through == 49
        overlapping = take(store, ingest, range(40, 60))
        assert overlapping.acknowledgement.repeated == 10
        assert len(powers(store, StoreQuestion(t_ns=0, about="radio"))) == 60


def test_another_line_s_bridge_is_refused_and_a_relay_may_speak_for_others(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, ingest), pytest.raises(ValueError, match="no bridge of line demo"):
        ingest.take(batch([measurement(0)], bridge="east/train/T1/lte_bridge"), NOW_NS)
    with opened(tmp_path) as (store, _):
        wayside = batch([measurement(0)], bridge="demo/wayside/W1/lte_bridge")
        assert Ingest("demo", store.had()).take(wayside, NOW_NS).acknowledgement.refused == 1
        trusted = Ingest("demo", store.had(), frozenset({"demo/wayside/W1"}))
        assert trusted.take(wayside, NOW_NS).acknowledgement.refused == 0


def test_what_was_committed_and_not_said_again_is_found_after_a_crash(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, ingest):
        taken = ingest.take(batch([measurement(n) for n in range(5)]), NOW_NS)
        number = store.commit(taken.commit)
    with opened(tmp_path) as (store, _):
        assert list(store.unpublished()) == [(number, [measurement(n) for n in range(5)])]
        store.published(number)
        assert list(store.unpublished()) == []
    with opened(tmp_path) as (store, ingest):
        assert store.commit(ingest.take(batch([service_event(1)], 5), NOW_NS).commit) > 0


CRASHING = """
import sys
from pathlib import Path
from services.cloud_analyzer.duckdb_store import DuckDbStore
from services.cloud_analyzer.ingest import Ingest
from tests.unit.cloud_analyzer.batches import DAY_NS, NOW_NS, batch, measurement
store = DuckDbStore(Path(sys.argv[1]))
ingest = Ingest("demo", store.had())
first = int(sys.argv[2])
while True:
    records = [measurement(n) for n in range(first, first + 200)]
    taken = ingest.take(batch(records, first, sent_ns=NOW_NS + DAY_NS), NOW_NS + DAY_NS)
    store.commit(taken.commit)
    ingest.confirm(taken)
    first += 200
    print(first, flush=True)
"""


def test_what_was_acknowledged_survives_kill_minus_nine(tmp_path: Path) -> None:
    acknowledged = 0
    for round_number in range(3):
        process = subprocess.Popen(
            [sys.executable, "-c", CRASHING, str(tmp_path), str(acknowledged)], stdout=subprocess.PIPE, text=True
        )
        assert process.stdout is not None
        for _ in range(3 + 4 * round_number):
            acknowledged = int(process.stdout.readline())
        os.kill(process.pid, signal.SIGKILL)
        # What it still said before the signal came was acknowledged as well.
        acknowledged = max([acknowledged, *map(int, process.stdout.read().split())])
        process.wait(10.0)
        process.stdout.close()
        with opened(tmp_path) as (store, _):
            rows = powers(store, StoreQuestion(t_ns=0, about="radio", limit=50_000))
        # A commit may have been on disk before its word was out; it is whole, and nothing is there twice.
        assert len(rows) in (acknowledged, acknowledged + 200)
        assert [number for number, _ in rows] == list(range(len(rows)))


def test_a_damaged_database_is_set_aside_and_closed_days_are_kept(tmp_path: Path) -> None:
    step = DAY_OF_ROWS // 50
    with opened(tmp_path) as (store, ingest):
        take(store, ingest, range(100), step)
        store.tend(NOW_NS + 30 * DAY_NS)
    (tmp_path / DATABASE).write_bytes(b"nothing that a database would be" * 1000)
    with opened(tmp_path) as (store, _):
        assert "damaged" in store.set_aside
        assert len(powers(store, StoreQuestion(t_ns=0, about="radio"))) == 100
    assert len(list(tmp_path.glob(f"{DATABASE}.damaged-*"))) == 1


def test_a_day_file_that_the_database_does_not_name_is_no_second_copy(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, ingest):
        take(store, ingest, range(10))
        store.tend(NOW_NS + 30 * DAY_NS)
        (file,) = tmp_path.glob("raw/radio/day=*/*.parquet")
    stray = file.with_name("000009.parquet")
    stray.write_bytes(file.read_bytes())
    with opened(tmp_path) as (store, _):
        assert len(powers(store, StoreQuestion(t_ns=0, about="radio"))) == 10
    assert not stray.exists()


@pytest.mark.parametrize("change", ["DROP COLUMN snr_db", "ADD COLUMN tomorrow VARCHAR"])
def test_a_store_of_an_older_or_a_newer_version_goes_on(tmp_path: Path, change: str) -> None:
    """A table and day files that lack a column of ours, or have one more."""
    step = DAY_OF_ROWS // 50
    with opened(tmp_path) as (store, ingest):
        take(store, ingest, range(200), step)
        store.tend(NOW_NS + 4 * DAY_NS)
    with duckdb.connect(str(tmp_path / DATABASE)) as connection:
        connection.execute(f"ALTER TABLE radio {change}")
        for file in tmp_path.glob("raw/radio/day=*/*.parquet"):
            connection.execute(f"CREATE OR REPLACE TABLE day AS FROM read_parquet('{file}', hive_partitioning=false)")
            connection.execute(f"ALTER TABLE day {change}")
            connection.execute(f"COPY day TO '{file}' (FORMAT parquet)")
        connection.execute("DROP TABLE day")
    with opened(tmp_path) as (store, ingest):
        take(store, ingest, range(200, 250), step)
        found = powers(store, StoreQuestion(t_ns=0, about="radio", limit=70))
        assert found == [(n * step, -70.0 - n * step % 7) for n in range(250)]
        assert "rows of radio" in store.tend(NOW_NS + 30 * DAY_NS)
        assert powers(store, StoreQuestion(t_ns=0, about="radio", limit=70)) == found
        assert store.learn() == store.learn_from_rows()


def test_old_days_are_forgotten(tmp_path: Path) -> None:
    with opened(tmp_path, keep_days=100.0) as (store, ingest):
        take(store, ingest, range(10))
        store.tend(NOW_NS + 30 * DAY_NS)
        assert "files older than" in store.tend(NOW_NS + 120 * DAY_NS)
        assert powers(store, StoreQuestion(t_ns=0, about="radio")) == []
        assert store.learn().sums == ()
    assert list(tmp_path.glob("raw/radio/day=*/*.parquet")) == []


def test_one_writer_at_a_time(tmp_path: Path) -> None:
    other = "from pathlib import Path; import sys; from services.cloud_analyzer.duckdb_store import DuckDbStore; "
    with opened(tmp_path):
        found = subprocess.run(
            [sys.executable, "-c", other + "DuckDbStore(Path(sys.argv[1]))", str(tmp_path)],
            capture_output=True,
            text=True,
            check=False,
        )
    assert found.returncode == 1
    assert "in use by another analyzer" in found.stderr


def test_a_commit_that_fails_keeps_nothing(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, ingest):
        taken = ingest.take(batch([measurement(n) for n in range(5)]), NOW_NS)
        store._connection.execute("DROP TABLE had")
        with pytest.raises(StoreError, match="took nothing"):
            store.commit(taken.commit)
        assert powers(store, StoreQuestion(t_ns=0, about="radio")) == []
    with opened(tmp_path) as (store, _):
        assert powers(store, StoreQuestion(t_ns=0, about="radio")) == []


def test_learned_sums_are_those_of_pass_values_and_stay_when_days_close(tmp_path: Path) -> None:
    step = 401  # of half seconds: 800 samples are two days, each pass of 1600 numbers four samples
    with opened(tmp_path) as (store, ingest):
        take(store, ingest, range(800), step)
        live = store.learn(by_day=True)
        assert store.learn_from_rows(by_day=True) == live
        assert store.tend(NOW_NS + 3 * DAY_NS).count("rows of radio") > 1
        assert store.learn(by_day=True) == live
        assert sum(one.n for one in store.learn().sums) == sum(one.n for one in live.sums)
        first_day = NOW_NS // DAY_NS
        days = {one.day for one in store.learn(first_day, first_day, by_day=True).sums}
        assert days == {first_day}
    expected: dict[tuple[object, ...], list[float]] = {}
    for n in range(0, 800 * step, step):
        day = (NOW_NS + n * STEP_NS) // DAY_NS
        place = int(n * 6.25 % 10_000 // 100)
        expected.setdefault((day, f"R{n % 5}", place, n // 1600), []).append(-70.0 - n % 7)
    bins: dict[tuple[object, ...], list[float]] = {}
    for (*group, _), values in expected.items():
        bins.setdefault(tuple(group), []).append(sum(values) / len(values))
    assert len(live.sums) == len(bins)
    for one in live.sums:
        values = bins[one.day, one.radio, one.section]
        assert one.n == len(values)
        assert one.total == pytest.approx(sum(values))
        assert one.squares == pytest.approx(sum(value * value for value in values))


def test_absurd_places_and_powers_are_kept_and_not_learned(tmp_path: Path) -> None:
    figures: list[dict[str, object]] = [
        {"chainage_m": 1e300},
        {"chainage_m": -math.inf},
        {"chainage_m": math.nan},
        {"channel_power_dbm": 1e9},
        {"channel_power_dbm": -math.inf},
        {"channel_power_dbm": -70.0},
    ]
    records = [measurement(n, **fields) for n, fields in enumerate(figures)]  # type: ignore[arg-type]  # fields of the message
    with opened(tmp_path) as (store, ingest):
        store.commit(ingest.take(batch(records), NOW_NS).commit)
        assert len(powers(store, StoreQuestion(t_ns=0, about="radio"))) == len(records)
        assert [(one.n, one.total) for one in store.learn().sums] == [(1, -70.0)]
        assert "6 rows of radio" in store.tend(NOW_NS + 30 * DAY_NS)
        assert [(one.n, one.total) for one in store.learn().sums] == [(1, -70.0)]


@pytest.mark.parametrize("page", ["x", "W10=", "////"])
def test_a_page_that_is_none_is_refused(tmp_path: Path, page: str) -> None:
    with opened(tmp_path) as (store, _):
        for about in ("radio", "radio_sums"):
            with pytest.raises(ValueError, match="no page"):
                store.ask(StoreQuestion(t_ns=0, about=about, page=page), 10.0)


def test_a_question_that_takes_too_long_is_ended(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, _):
        endless = "SELECT count(*) FROM range(10000000000) a, range(1000000) b"
        with pytest.raises(StoreTimeoutError, match="shorter"):
            store._read(endless, {}, 0.05)
        assert powers(store, StoreQuestion(t_ns=0, about="radio")) == []
