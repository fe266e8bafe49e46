"""The bridge: what it takes in, what it brings over, how soon it is there with a large backlog.

Four comparisons, with full sync throughout:
- `spool`: records put down in commits of a thousand, beside SQLite with one commit per record
  (what a service that stores for itself would do first);
- `bus to disk`: a speaker, a router and a bridge in processes of their own, until all of it is on disk, beside
  Zenoh's advanced publisher and subscriber on the same path, which keep nothing on disk;
- `drain`: from the spool of one bridge over two routers to another one that commits, acknowledges
  and says it again;
- `start`: opening the spool with a backlog of 1 GB and giving its first batch, beside counting such a backlog.
"""

from __future__ import annotations

import json as json_text
import random
import shutil
import socket
import sqlite3
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict
from pathlib import Path

from benchmarks.bridge_roles import CLOUD, TRAIN, bridge, records, speak
from benchmarks.bus import answer, machine, process, run_round
from benchmarks.bus_roles import Flow, route
from benchmarks.comparison import Result, seconds, table
from schemas.bridge import BridgedRecord
from services.lte_bridge.spool_store import Spool

ROUNDS = 3
PUT_RECORDS = 100_000
PEER_RECORDS = 1_000
BUS_RECORDS = 60_000
DRAIN_RECORDS = 300_000
BACKLOG_BYTES = 1_000_000_000
CAP_BYTES = 4_000_000_000
PATIENCE_S = 120.0


def opened(folder: Path) -> Spool:
    """Open spool."""
    spool = Spool(folder, CAP_BYTES)
    spool.open()
    return spool


def put_all(folder: Path, everything: list[BridgedRecord], step: int = 1000) -> float:
    """Time to put records into a new spool [s]."""
    shutil.rmtree(folder, ignore_errors=True)
    spool = opened(folder)
    try:
        return seconds(lambda: [spool.put(everything[at : at + step]) for at in range(0, len(everything), step)])
    finally:
        spool.close()


def put_one_by_one(path: Path, everything: list[BridgedRecord]) -> float:
    """Time that SQLite takes for a commit per record [s]."""
    path.unlink(missing_ok=True)
    with closing(sqlite3.connect(path, isolation_level=None)) as plain:
        plain.execute("PRAGMA journal_mode = WAL")
        plain.execute("PRAGMA synchronous = FULL")
        plain.execute("CREATE TABLE record(id INTEGER PRIMARY KEY, key TEXT, payload BLOB, attachment BLOB)")
        return seconds(
            lambda: [
                plain.execute(
                    "INSERT INTO record(key, payload, attachment) VALUES (?, ?, ?)", (r.key, r.payload, r.attachment)
                )
                for r in everything
            ]
        )


def spool_rates(folder: Path, rounds: int) -> Result:
    """The spool alone."""
    everything = records(0, PUT_RECORDS)
    ours, theirs = [], []
    for _ in range(rounds):
        ours.append(PUT_RECORDS / put_all(folder / "spool", everything))
        theirs.append(PEER_RECORDS / put_one_by_one(folder / "plain.sqlite", everything[:PEER_RECORDS]))
    mine, peer = statistics.median(ours), statistics.median(theirs)
    return Result("spool", "measurements, full sync", "records/s", mine, "a commit each", peer, mine / peer)


@contextmanager
def routers(count: int) -> Iterator[list[str]]:
    """Endpoints of running routers."""
    with process(route, endpoint := _endpoint()) as first:
        answer(first)
        if count == 1:
            yield [endpoint]
        else:
            with routers(count - 1) as others:
                yield [endpoint, *others]
        first.send("end")


def _endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def until_lane(path: Path, column: str, wanted: int) -> float:
    """Monotonic time at which the bulk lane of a spool has come to a value. Raises TimeoutError."""
    with closing(sqlite3.connect(path, timeout=5.0)) as looking:
        limit_s = time.monotonic() + PATIENCE_S
        while looking.execute(f"SELECT {column} FROM lane WHERE lane = 'bulk'").fetchone()[0] != wanted:  # noqa: S608 - our own columns
            if time.monotonic() > limit_s:
                raise TimeoutError
            time.sleep(0.01)
    return time.monotonic()


def bus_to_disk(folder: Path, rounds: int) -> Result:
    """Through the bus into the spool."""
    ours, theirs = [], []
    for _ in range(rounds):
        shutil.rmtree(folder / "train", ignore_errors=True)
        settings: dict[str, object] = {"folder": str(folder / "train"), "far": {"name": "C1"}}
        with routers(1) as (router,), process(bridge, TRAIN, router, settings) as bridging:
            answer(bridging)
            with process(speak, router, BUS_RECORDS) as speaking:
                began_s = answer(speaking)
                ended_s = until_lane(folder / "train" / "spool.sqlite", "next", BUS_RECORDS)
                speaking.send("end")
            bridging.send("end")
        if not isinstance(began_s, float):
            raise TypeError
        ours.append(BUS_RECORDS / (ended_s - began_s))
        with routers(1) as (router,):
            theirs.append(run_round(router, Flow("kept", BUS_RECORDS, None, timed=False), ("node", "raw"))[1].rate_hz)
    mine, peer = statistics.median(ours), statistics.median(theirs)
    return Result("bus to disk", "measurements, full sync", "records/s", mine, "Zenoh, in memory", peer, mine / peer)


def drain(folder: Path, rounds: int) -> Result:
    """From spool to spool, acknowledged."""
    rates = []
    everything = records(0, DRAIN_RECORDS)
    put_all(folder / "full", everything, 4000)
    for _ in range(rounds):
        for name in ("train", "cloud"):
            shutil.rmtree(folder / name, ignore_errors=True)
        shutil.copytree(folder / "full", folder / "train")
        with routers(2) as (here, there):
            receiving: dict[str, object] = {"folder": str(folder / "cloud"), "receives": True}
            sending: dict[str, object] = {
                "folder": str(folder / "train"),
                "far": {"name": "C1"},
                "uplink": {"connect": [there]},
            }
            with process(bridge, CLOUD, there, receiving) as cloud:
                answer(cloud)
                with process(bridge, TRAIN, here, sending) as train:
                    began_s = answer(train)
                    ended_s = until_lane(folder / "train" / "spool.sqlite", "records", 0)
                    train.send("end")
                cloud.send("end")
        if not isinstance(began_s, float):
            raise TypeError
        rates.append(DRAIN_RECORDS / (ended_s - began_s))
    return Result("drain", "measurements, acknowledged", "records/s", statistics.median(rates), "", None, None)


def start(folder: Path, rounds: int) -> Result:
    """Opening a spool with a gigabyte in it."""
    rng = random.Random(1)  # noqa: S311 - no secret
    shutil.rmtree(folder / "large", ignore_errors=True)
    spool = opened(folder / "large")
    number = 0
    while spool.held().bytes < BACKLOG_BYTES:
        large = [
            BridgedRecord(key=r.key, payload=rng.randbytes(300), attachment=r.attachment, heard_ns=r.heard_ns)
            for r in records(number, 1000)
        ]
        spool.put(large)
        number += len(large)
    spool.close()

    def begin() -> None:
        again = opened(folder / "large")
        if again.cut("bulk", 60_000) is None:
            raise ValueError
        again.close()

    def count() -> None:
        with closing(sqlite3.connect(folder / "large" / "spool.sqlite")) as looking:
            looking.execute("SELECT sum(count), sum(length(body)) FROM batch NOT INDEXED").fetchone()

    ours = statistics.median(seconds(begin) for _ in range(rounds))
    theirs = statistics.median(seconds(count) for _ in range(rounds))
    shutil.rmtree(folder / "large")
    return Result("start", "1 GB backlog", "ms", 1e3 * ours, "counting it", 1e3 * theirs, theirs / ours)


def run(*, json: bool = False, rounds: int = ROUNDS) -> list[Result]:
    """Measure, print the table (or JSON) and give the results. Takes about two minutes."""
    about = machine()
    results = []
    with tempfile.TemporaryDirectory() as name:
        for measure in (spool_rates, bus_to_disk, drain, start):
            sys.stderr.write(f"\r\x1b[K{measure.__name__}")
            sys.stderr.flush()
            results.append(measure(Path(name), rounds))
        sys.stderr.write("\r\x1b[K")
    if json:
        found = {"machine": about, "results": [asdict(result) for result in results]}
        sys.stdout.write(json_text.dumps(found, indent=2) + "\n")
    else:
        sys.stdout.write(f"{about}\nmedians of {rounds} rounds\n{table(results)}\n")
    return results


if __name__ == "__main__":
    run(json="--json" in sys.argv[1:])
