"""Tables of a spool: how they are made, and the totals that stand in them.

SQLite in WAL mode; every commit waits until the disk has it (synchronous = FULL). Free pages are
given back in small steps (auto_vacuum = INCREMENTAL).
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from services.lte_bridge.lane import LANES, Lane

FORMAT = 1
ROW_OVERHEAD_BYTES = 100
"""What a batch takes on disk beside its body, roughly."""
WAL_KEPT_BYTES = 8 * 1024 * 1024
_SCHEMA = """
CREATE TABLE meta(name TEXT PRIMARY KEY, value) WITHOUT ROWID;
CREATE TABLE lane(lane TEXT PRIMARY KEY, next INTEGER NOT NULL, through INTEGER NOT NULL,
                  records INTEGER NOT NULL, bytes INTEGER NOT NULL, dropped INTEGER NOT NULL) WITHOUT ROWID;
CREATE TABLE batch(id INTEGER PRIMARY KEY, lane TEXT NOT NULL, first INTEGER NOT NULL, count INTEGER NOT NULL,
                   oldest_ns INTEGER NOT NULL, newest_ns INTEGER NOT NULL, body BLOB NOT NULL);
CREATE UNIQUE INDEX batch_order ON batch(lane, first);
CREATE TABLE heard(name TEXT PRIMARY KEY, state BLOB NOT NULL, used INTEGER NOT NULL) WITHOUT ROWID;
CREATE TABLE damaged(id INTEGER PRIMARY KEY, lane TEXT, first INTEGER, count INTEGER, reason TEXT, body BLOB);
"""
_HEAD = "SELECT id, first, count, length(body) FROM batch"
DAMAGED_KEPT = 64
"""Batches in quarantine; older ones go."""
_DAMAGE = {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_FORMAT}


@dataclass(slots=True)
class LaneTotals:
    """One lane of a spool."""

    next: int = 0
    """Number of the next record. Never repeats within a spool."""
    through: int = -1
    """Everything up to and with this number is acknowledged."""
    records: int = 0
    """That wait."""
    bytes: int = 0
    """On disk, roughly."""
    dropped: int = 0
    """Records dropped for want of room since the spool was made."""


@dataclass(frozen=True, slots=True)
class Row:
    """A batch as it stands in a spool."""

    id: int
    lane: Lane
    first: int
    count: int
    oldest_ns: int
    newest_ns: int
    body: bytes


COLUMNS = "id, lane, first, count, oldest_ns, newest_ns, body"


def is_damage(error: sqlite3.Error) -> bool:
    """Whether the file itself is broken, so that trying again does not help."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in _DAMAGE


def connect(path: Path) -> sqlite3.Connection:
    """Connection to a spool or journal that exists or is to be; transactions are begun by hand."""
    connection = sqlite3.connect(path, timeout=5.0, isolation_level=None, check_same_thread=False)
    connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute(f"PRAGMA journal_size_limit = {WAL_KEPT_BYTES}")
    return connection


@contextmanager
def transaction(connection: sqlite3.Connection) -> Iterator[None]:
    """Everything inside, durably, or nothing of it."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        with suppress(sqlite3.Error):  # SQLite has rolled back by itself after a full disk
            connection.execute("ROLLBACK")
        raise


def create(connection: sqlite3.Connection, spool_id: str) -> None:
    """Make the tables of an empty spool."""
    with transaction(connection):
        for statement in _SCHEMA.split(";"):
            connection.execute(statement)
        connection.executemany(
            "INSERT INTO meta VALUES (?, ?)",
            [("format", FORMAT), ("spool_id", spool_id), ("quarantined", 0)],
        )
        for lane in LANES:
            connection.execute("INSERT INTO lane VALUES (?, 0, -1, 0, 0, 0)", (lane,))


def is_empty(connection: sqlite3.Connection) -> bool:
    """Whether no tables have been made yet."""
    return bool(connection.execute("SELECT count(*) FROM sqlite_schema").fetchone()[0] == 0)


def meta(connection: sqlite3.Connection) -> dict[str, str | int]:
    """Everything in `meta`."""
    return dict(connection.execute("SELECT name, value FROM meta"))


def totals(connection: sqlite3.Connection) -> dict[Lane, LaneTotals]:
    """Totals of both lanes. Raises sqlite3.DatabaseError when a lane is missing."""
    found: dict[Lane, LaneTotals] = {}
    for lane in LANES:
        row = connection.execute(
            "SELECT next, through, records, bytes, dropped FROM lane WHERE lane = ?", (lane,)
        ).fetchone()
        if row is None:
            msg = f"the lane {lane} is missing"
            raise sqlite3.DatabaseError(msg)
        found[lane] = LaneTotals(*row)
    return found


def save_totals(connection: sqlite3.Connection, lanes: dict[Lane, LaneTotals]) -> None:
    """Put the totals down, within a transaction."""
    connection.executemany(
        "UPDATE lane SET next = ?, through = ?, records = ?, bytes = ?, dropped = ? WHERE lane = ?",
        [(t.next, t.through, t.records, t.bytes, t.dropped, lane) for lane, t in lanes.items()],
    )


def cost(body_bytes: int) -> int:
    """What a batch counts against the cap."""
    return body_bytes + ROW_OVERHEAD_BYTES


def insert(connection: sqlite3.Connection, totals: LaneTotals, row: Row) -> int:
    """Append a batch to its lane within a transaction; its numbers follow the lane's last. Returns its id."""
    cursor = connection.execute(
        "INSERT INTO batch(lane, first, count, oldest_ns, newest_ns, body) VALUES (?, ?, ?, ?, ?, ?)",
        (row.lane, totals.next, row.count, row.oldest_ns, row.newest_ns, row.body),
    )
    totals.next += row.count
    totals.records += row.count
    totals.bytes += cost(len(row.body))
    return cursor.lastrowid or 0


def drop_oldest(connection: sqlite3.Connection, lane: Lane, totals: LaneTotals) -> bool:
    """Drop the oldest batch of a lane and count it, within a transaction; False when there is none."""
    row = connection.execute(f"{_HEAD} WHERE lane = ? ORDER BY first LIMIT 1", (lane,)).fetchone()
    if row is None:
        return False
    totals.dropped += _remove(connection, totals, *row)
    return True


def put_into_quarantine(connection: sqlite3.Connection, lane: Lane, totals: LaneTotals, first: int, reason: str) -> int:
    """Move the batch that holds number `first` aside, within a transaction; the records lost by that."""
    row = connection.execute(
        f"{_HEAD} WHERE lane = ? AND first <= ? ORDER BY first DESC LIMIT 1", (lane, first)
    ).fetchone()
    if row is None:
        return 0
    connection.execute(
        "INSERT INTO damaged(lane, first, count, reason, body) "
        "SELECT lane, first, count, ?, body FROM batch WHERE id = ?",
        (reason, row[0]),
    )
    connection.execute("DELETE FROM damaged WHERE id <= (SELECT max(id) FROM damaged) - ?", (DAMAGED_KEPT,))
    return _remove(connection, totals, *row)


def let_go(connection: sqlite3.Connection, lane: Lane, totals: LaneTotals, through: int) -> int:
    """Delete what is acknowledged up to and with `through`, within a transaction; how many records that were."""
    rows = connection.execute(f"{_HEAD} WHERE lane = ? AND first <= ? ORDER BY first", (lane, through)).fetchall()
    gone = 0
    for number, first, count, size in rows:
        last = first + count - 1
        if last <= through:
            gone += _remove(connection, totals, number, first, count, size)
        else:
            part = through - max(first - 1, totals.through)
            gone += part
            totals.records -= part
    totals.through = max(totals.through, through)
    return gone


def _remove(connection: sqlite3.Connection, totals: LaneTotals, number: int, first: int, count: int, size: int) -> int:
    """Delete a batch; the records of it that had not been acknowledged."""
    connection.execute("DELETE FROM batch WHERE id = ?", (number,))
    waiting = first + count - 1 - max(totals.through, first - 1)
    totals.records -= waiting
    totals.bytes -= cost(size)
    return waiting
