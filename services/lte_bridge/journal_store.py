"""What a far end has received: durable before it is acknowledged, kept until it has been said again."""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from schemas.bridge import BridgeBatch, BridgedRecord
from services.lte_bridge.batch import BatchError, packed, unpacked
from services.lte_bridge.deduplication import Deduplication, StateRow
from services.lte_bridge.lane import LANES, Lane, lane_of
from services.lte_bridge.rescue_store import put_aside
from services.lte_bridge.spool_table_store import connect, is_damage, transaction

QUARANTINE_KEPT = 1000
_SCHEMA = """
CREATE TABLE IF NOT EXISTS memory(name TEXT PRIMARY KEY, state BLOB NOT NULL, used INTEGER NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS unsaid(id INTEGER PRIMARY KEY AUTOINCREMENT, lane TEXT NOT NULL, count INTEGER NOT NULL,
                                  body BLOB NOT NULL);
CREATE INDEX IF NOT EXISTS unsaid_order ON unsaid(lane, id);
CREATE TABLE IF NOT EXISTS quarantine(id INTEGER PRIMARY KEY, key TEXT, reason TEXT, body BLOB);
"""


class JournalFaultError(Exception):
    """The disk did not take it: nothing is acknowledged, the sender tries again."""


@dataclass(frozen=True, slots=True)
class Taken:
    """What became of a batch."""

    through: int
    fresh: int
    repeated: int
    refused: int


@dataclass(frozen=True, slots=True)
class Unsaid:
    """Records received that have not been said again."""

    id: int
    lane: Lane
    size: int
    records: list[BridgedRecord]


@dataclass(slots=True)
class Journal:
    """Make it with `Journal(path)` and `open`. May be used from any thread; one call at a time works.

    Every method raises JournalFaultError when the disk is full or failing. A damaged file is put
    aside and begun anew with what can be read, told of in `notes`.
    """

    path: Path
    notes: list[str] = field(default_factory=list)
    unsaid_bytes: int = 0
    _lock: threading.RLock = field(default_factory=threading.RLock)
    _connection: sqlite3.Connection | None = None
    _memory: Deduplication = field(default_factory=Deduplication)
    _last: dict[Lane, int] = field(default_factory=dict)
    """Number up to which each lane has been said since the start."""
    _settled: dict[Lane, int] = field(default_factory=dict)

    def open(self) -> None:
        """Open or make the journal. Raises JournalFaultError, and OSError for the folder."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with suppress(JournalFaultError), self._guarded():
            return
        with self._guarded():  # a damaged file has been put aside
            return

    def close(self) -> None:
        """Let go of the file."""
        with self._lock:
            if self._connection is not None:
                self._connection.close()
                self._connection = None

    def take(self, batch: BridgeBatch) -> Taken:
        """Make the new records of a batch durable. Raises BatchError for one that cannot be read."""
        records = unpacked(batch.compressed, batch.count)
        with self._guarded() as connection:
            judgement = self._memory.judge(batch, records)
            known = [record for record in judgement.fresh if lane_of(record.key) is not None]
            unknown = [record for record in judgement.fresh if lane_of(record.key) is None]
            body = batch.compressed if len(known) == batch.count else packed(known)
            with transaction(connection):
                if known:
                    connection.execute(
                        "INSERT INTO unsaid(lane, count, body) VALUES (?, ?, ?)", (batch.lane, len(known), body)
                    )
                for record in unknown:
                    _quarantine(connection, record, "no topic that is kept has this key here")
                connection.executemany(
                    "INSERT OR REPLACE INTO memory VALUES (?, ?, ?)",
                    [(row.name, row.state, row.used) for row in judgement.rows],
                )
                connection.executemany("DELETE FROM memory WHERE name = ?", [(name,) for name in judgement.forgotten])
            self._memory.apply(judgement)
            self.unsaid_bytes += len(body) if known else 0
            return Taken(judgement.through, len(known), judgement.repeated, len(unknown))

    def next_unsaid(self) -> Unsaid | None:
        """The oldest records that wait to be said again, events first; None when nothing waits."""
        while True:
            with self._guarded() as connection:
                row = self._oldest(connection)
                if row is None:
                    return None
                number, lane, count, body = row
                try:
                    return Unsaid(number, lane, len(body), unpacked(body, count))
                except BatchError as error:
                    self.said(Unsaid(number, lane, len(body), []))
                    connection.execute(
                        "INSERT INTO quarantine(key, reason, body) VALUES ('', ?, ?)", (str(error), body)
                    )
                    self.notes.append(f"{count} received records cannot be read and are in quarantine: {error}")

    def said(self, unsaid: Unsaid) -> None:
        """Go on to the next records."""
        self._last[unsaid.lane] = unsaid.id
        self.unsaid_bytes -= unsaid.size

    def refuse(self, refused: list[tuple[BridgedRecord, str]]) -> None:
        """Put records that cannot be said again into quarantine, with the reasons."""
        with self._guarded() as connection, transaction(connection):
            for record, reason in refused:
                _quarantine(connection, record, reason)

    def settle(self) -> None:
        """Let go of what had been said when this was called before; until then a restart says it once more.

        To be called every few seconds: what a process has said may still lie in its own queues
        when it is killed.
        """
        with self._guarded() as connection, transaction(connection):
            for lane, number in self._settled.items():
                connection.execute("DELETE FROM unsaid WHERE lane = ? AND id <= ?", (lane, number))
        self._settled = dict(self._last)

    def _oldest(self, connection: sqlite3.Connection) -> tuple[int, Lane, int, bytes] | None:
        for lane in LANES:
            row = connection.execute(
                "SELECT id, lane, count, body FROM unsaid WHERE lane = ? AND id > ? ORDER BY id LIMIT 1",
                (lane, self._last.get(lane, 0)),
            ).fetchone()
            if row is not None:
                found: tuple[int, Lane, int, bytes] = row
                return found
        return None

    @contextmanager
    def _guarded(self) -> Iterator[sqlite3.Connection]:
        with self._lock:
            try:
                if self._connection is None:
                    self._load()
                assert self._connection is not None  # noqa: S101 - `_load` has just set it
                yield self._connection
            except sqlite3.Error as error:
                if is_damage(error):
                    self._begin_anew()
                raise JournalFaultError(str(error)) from error
            except OSError as error:
                raise JournalFaultError(str(error)) from error

    def _load(self) -> None:
        connection = connect(self.path)
        try:
            connection.executescript(_SCHEMA)
            self._memory = Deduplication()
            self._memory.restore(
                StateRow(*row) for row in connection.execute("SELECT name, state, used FROM memory").fetchall()
            )
            self._last, self._settled = {}, {}
            self.unsaid_bytes = connection.execute("SELECT coalesce(sum(length(body)), 0) FROM unsaid").fetchone()[0]
        except sqlite3.Error:
            connection.close()
            raise
        self._connection = connection

    def _begin_anew(self) -> None:
        """Put a damaged journal aside, and take over what can be read of it."""
        self.close()
        aside = put_aside(self.path)
        saved = {"memory": 0, "unsaid": 0}
        with closing(sqlite3.connect(aside)) as old, closing(connect(self.path)) as new:
            new.executescript(_SCHEMA)
            with transaction(new):
                for name, columns in (("memory", "name, state, used"), ("unsaid", "id, lane, count, body")):
                    with suppress(sqlite3.Error):
                        for row in old.execute(f"SELECT {columns} FROM {name}"):  # noqa: S608 - our own names
                            marks = ",".join("?" * len(row))
                            new.execute(f"INSERT OR IGNORE INTO {name}({columns}) VALUES ({marks})", row)  # noqa: S608 - our own names
                            saved[name] += 1
        self.notes.append(
            f"a damaged journal was put aside as {aside}: {saved['unsaid']} batches to be said again and the memory of "
            f"{saved['memory']} streams were saved; what was received before may be said once more"
        )


def _quarantine(connection: sqlite3.Connection, record: BridgedRecord, reason: str) -> None:
    connection.execute(
        "INSERT INTO quarantine(key, reason, body) VALUES (?, ?, ?)", (record.key, reason, packed([record]))
    )
    connection.execute("DELETE FROM quarantine WHERE id <= (SELECT max(id) FROM quarantine) - ?", (QUARANTINE_KEPT,))
