"""The cloud's store: rows taken and made durable, what is learned from many, and the daily update.

Peers: SQLite (write-ahead log, full sync, the same batches), and numpy over arrays that lie in memory already.
`KIROTEI_BENCH_ROWS` sets how many rows are learned from (5 million when left out).
"""

from __future__ import annotations

import json as json_text
import os
import sqlite3
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

import numpy as np

from benchmarks.comparison import Result, alternate, seconds, table
from schemas.bridge import BridgeBatch, BridgedRecord
from schemas.codec import decode, encode
from schemas.radio import RadioMeasurement
from schemas.topic import Place
from schemas.topics import RADIO_MEASUREMENT
from services.cloud_analyzer.duckdb_store import DuckDbStore
from services.cloud_analyzer.history import DAY_NS
from services.cloud_analyzer.history_work import HistoryWork
from services.cloud_analyzer.ingest import Ingest
from services.cloud_analyzer.tables import RADIO
from services.lte_bridge.batch import packed, unpacked
from services.runtime.attachment import Attachment, encode_attachment

ROWS = int(os.environ.get("KIROTEI_BENCH_ROWS", "5000000"))
DAYS = 60
BATCH = 2000
BATCHES = 25
T0_NS = 1_790_000_000_000_000_000 // DAY_NS * DAY_NS
KEY = RADIO_MEASUREMENT.at(Place("demo", "train", "T1"), device="r1")


def _record(number: int) -> BridgedRecord:
    t_ns = T0_NS + number * 500_000_000
    message = RadioMeasurement(
        t_ns=t_ns,
        radio=f"R{number % 5}",
        channel="2412",
        channel_power_dbm=-70.0 - number % 7,
        decoded_power_dbm=-71.0 - number % 5,
        received_ratio=0.98,
        chainage_m=number * 6.25 % 10_000,
        direction="up",
        pass_id=f"T1-{number // 1600}",
    )
    mark = encode_attachment(Attachment("demo/train/T1/radio_probe", "b1", number, t_ns))
    return BridgedRecord(key=KEY, payload=encode(message), attachment=mark, heard_ns=t_ns)


def _batches() -> list[BridgeBatch]:
    return [
        BridgeBatch(
            t_ns=T0_NS + DAY_NS,
            bridge="demo/train/T1/lte_bridge",
            lane="bulk",
            spool_id="s",
            first=first,
            count=BATCH,
            compressed=packed([_record(first + n) for n in range(BATCH)]),
        )
        for first in range(0, BATCH * BATCHES, BATCH)
    ]


def _ingest(batches: Sequence[BridgeBatch]) -> float:
    with tempfile.TemporaryDirectory() as folder, closing(DuckDbStore(Path(folder))) as store:
        ingest = Ingest("demo", store.had())

        def work() -> None:
            for one in batches:
                taken = ingest.take(one, T0_NS + DAY_NS)
                store.published(store.commit(taken.commit))
                ingest.confirm(taken)

        return seconds(work)


def _sqlite(batches: Sequence[BridgeBatch]) -> float:
    """What a user would write: each batch unpacked, decoded, and inserted in one transaction, duplicates ignored."""
    names = ("t_ns", *RADIO.names[9:])
    with tempfile.TemporaryDirectory() as folder, closing(sqlite3.connect(f"{folder}/peer.db")) as connection:
        connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA synchronous=FULL")
        connection.execute(f"CREATE TABLE radio (mark BLOB PRIMARY KEY, {', '.join(names)})")

        def work() -> None:
            for one in batches:
                rows = []
                for record in unpacked(one.compressed, one.count):
                    message = decode(RadioMeasurement, record.payload)
                    rows.append((record.attachment, *(getattr(message, name) for name in names)))
                with connection:
                    marks = ",".join("?" * (len(names) + 1))
                    connection.executemany(f"INSERT OR IGNORE INTO radio VALUES ({marks})", rows)  # noqa: S608 - placeholders

        return seconds(work)


def _fill(store: DuckDbStore, rows: int) -> None:
    """Closed days of made-up passes, by the engine itself: filling is not what is measured."""
    connection = store._connection  # noqa: SLF001 - millions of rows through the front door would take longer than all else
    each = rows // DAYS
    for day in range(DAYS):
        start_ns = T0_NS + day * DAY_NS
        connection.execute(
            f"INSERT INTO radio BY NAME SELECT {start_ns} + i * ({DAY_NS} // {each}) AS taken_ns, "  # noqa: S608 - numbers of our own
            f"{start_ns} + i * ({DAY_NS} // {each}) AS t_ns, '' AS clock, 'demo' AS line, 'train/T1' AS place, "
            f"'{KEY}' AS key, 'demo/train/T1/radio_probe' AS source, 'b1' AS boot_id, i AS sequence, "
            "'R' || (i // 320 % 50) AS radio, CAST(2412 + 5 * (i % 4) AS VARCHAR) AS channel, 'onboard' AS side, "
            "CASE WHEN i // 16000 % 2 = 0 THEN 'up' ELSE 'down' END AS direction, '' AS branch, "
            "'P' || (i // 16000) AS pass_id, '' AS train, '' AS cell, (i * 1.0) % 16000 AS chainage_m, "
            "-70 - (hash(i) % 1000) / 100.0 AS channel_power_dbm, 0.98 AS received_ratio "
            f"FROM range({each}) t(i)"
        )
        store.tend(T0_NS + (day + 4) * DAY_NS)


def _learning(rows: int, rounds: int) -> list[Result]:
    with tempfile.TemporaryDirectory() as folder, closing(DuckDbStore(Path(folder), threads=2)) as store:
        _fill(store, rows)
        store.tend(T0_NS + (DAYS + 10) * DAY_NS)
        kept = store.learn()
        scanned = store.learn_from_rows()
        if [one[:7] for one in kept.sums] != [one[:7] for one in scanned.sums]:
            msg = "the sums that are kept are not those of the rows"
            raise AssertionError(msg)
        section, power, group = _arrays(rows)
        ours, theirs = alternate(rounds, lambda: seconds(store.learn), lambda: _numpy(section, power, group))
        scan = min(seconds(store.learn_from_rows) for _ in range(2))
        update = _daily(store, rounds)
        history = HistoryWork(store, "demo")
        modelled = seconds(lambda: history.learn(T0_NS, T0_NS + DAY_NS, T0_NS + (DAYS + 10) * DAY_NS))
    peer = "numpy over arrays in memory, one level"
    shown = f"{rows / 1e6:g} M rows, {len(kept.sums)} sums"
    return [
        Result("learn, sums kept", shown, "ms", ours * 1e3, peer, (theirs or 0.0) * 1e3, (theirs or 0.0) / ours),
        Result("learn, every row anew", shown, "ms", scan * 1e3, peer, (theirs or 0.0) * 1e3, (theirs or 0.0) / scan),
        Result("daily update", f"{rows // DAYS} rows", "ms", update * 1e3, "", None, None, "sums of one day anew"),
        Result("radio model of a day", f"{rows // DAYS} rows", "s", modelled, "", None, None, "passes, held out, kept"),
    ]


def _daily(store: DuckDbStore, rounds: int) -> float:
    """Sums of one closed day, from its file, until they are on disk."""
    day = time.strftime("%Y-%m-%d", time.gmtime(T0_NS / 1e9))

    def update() -> None:
        with store._transaction() as connection:  # noqa: SLF001 - a part of `tend`
            store._keep_sums(connection, day)  # noqa: SLF001 - the same

    return min(seconds(update) for _ in range(rounds + 2))


def _arrays(rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    number = np.arange(rows)
    return number % 16000 // 100, -70.0 - (number % 1000) / 100.0, number // 320 % 50 * 8 + number % 4


def _numpy(section: np.ndarray, power: np.ndarray, group: np.ndarray) -> float:
    def work() -> None:
        key = group * 160 + section
        np.bincount(key), np.bincount(key, power), np.bincount(key, power * power)

    return seconds(work)


def run(*, json: bool, rounds: int) -> None:
    """Measure and print."""
    batches = _batches()
    ours, theirs = alternate(min(rounds, 3), lambda: _ingest(batches), lambda: _sqlite(batches))
    rows = BATCH * BATCHES
    results = [
        Result(
            "rows taken, durable",
            f"{BATCHES} batches of {BATCH}",
            "1000 rows/s",
            rows / ours / 1e3,
            "SQLite",
            rows / (theirs or 1.0) / 1e3,
            (theirs or 0.0) / ours,
        ),
        *_learning(ROWS, min(rounds, 3)),
    ]
    sys.stdout.write(json_text.dumps([asdict(one) for one in results], indent=1) if json else table(results))
    sys.stdout.write("\n")
