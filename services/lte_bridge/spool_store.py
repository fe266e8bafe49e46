"""The bridge's memory on disk: records wait in two lanes until the far end has acknowledged them."""

from __future__ import annotations

import fcntl
import secrets
import sqlite3
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TextIO

from schemas.bridge import BridgedRecord
from schemas.codec import MAX_MESSAGE_BYTES
from services.lte_bridge import rescue_store
from services.lte_bridge import spool_table_store as table
from services.lte_bridge.batch import chunks, packed
from services.lte_bridge.cutting import Cut, Damage, Piece, cut_of
from services.lte_bridge.deduplication import Deduplication, StateRow
from services.lte_bridge.fold_store import Folder
from services.lte_bridge.lane import LANES, Lane, lane_of
from services.lte_bridge.spool_table_store import LaneTotals, Row, cost
from services.lte_bridge.telling import Held

MOST_RECORD_BYTES = MAX_MESSAGE_BYTES - 64 * 1024
"""A larger record may not fit into a batch that a receiver takes."""
READ_ROWS = 64
"""Rows looked at for one batch to the far end."""
TIDY_PAGES = 256
"""Free pages given back to the file system at a time: about a megabyte, a few milliseconds."""
TIDY_FROM_PAGES = 4096


class SpoolFaultError(Exception):
    """The disk did not take or give something; everything acknowledged is still there. Try again."""


class SpoolInUseError(Exception):
    """Another bridge has this spool."""


@dataclass(slots=True)
class Spool:
    """Make it with `Spool(folder, cap)` and `open`. May be used from any thread; one call at a time works.

    Every method but `status` raises SpoolFaultError when the disk is full or failing. A file found
    damaged is put aside, saved from as far as it can be read, and told of in `notes`.
    """

    folder: Path
    cap_bytes: int
    spool_id: str = ""
    notes: list[str] = field(default_factory=list)
    """What people should know, oldest first; taken out by the reader."""
    _lock: threading.RLock = field(default_factory=threading.RLock)
    _connection: sqlite3.Connection | None = None
    _lanes: dict[Lane, LaneTotals] = field(default_factory=lambda: {lane: LaneTotals() for lane in LANES})
    _quarantined: int = 0
    _refusing: bool = False
    _memory: Deduplication = field(default_factory=Deduplication)
    _folding: Folder = field(default_factory=Folder)
    _held: TextIO | None = None

    @property
    def path(self) -> Path:
        """The spool's file."""
        return self.folder / "spool.sqlite"

    def open(self) -> None:
        """Open or make the spool. Raises SpoolInUseError, SpoolFaultError, and OSError for the folder."""
        self.folder.mkdir(parents=True, exist_ok=True)
        held = (self.folder / "lock").open("w")
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            held.close()
            msg = f"another bridge uses {self.folder}"
            raise SpoolInUseError(msg) from error
        self._held = held
        try:
            with self._guarded():
                self._open()
        except SpoolFaultError:
            if self._connection is None:  # a damaged file has been put aside by now, and a new one is open
                raise

    def close(self) -> None:
        """Let go of the file; what is in it stays."""
        with self._lock:
            if self._connection is not None:
                self._connection.close()
                self._connection = None
            if self._held is not None:
                self._held.close()
                self._held = None

    def put(self, records: Sequence[BridgedRecord], dropped: Mapping[Lane, int] | None = None) -> int:
        """Make records durable, in their order; the number that were not there before.

        What the bus said again is left out. Above the cap the oldest bulk makes room; where
        events alone fill the spool, what is new is refused. Both are counted as dropped, as is
        what the caller had to drop before (`dropped`).
        """
        with self._guarded() as connection:
            judgement = self._memory.judge_heard(records)
            with table.transaction(connection):
                for lane in LANES:
                    self._lanes[lane].dropped += (dropped or {}).get(lane, 0)
                    for chunk in chunks(self._fitting(lane, judgement.fresh)):
                        self._append(connection, lane, chunk)
                connection.executemany(
                    "INSERT OR REPLACE INTO heard VALUES (?, ?, ?)",
                    [(row.name, row.state, row.used) for row in judgement.rows],
                )
                connection.executemany("DELETE FROM heard WHERE name = ?", [(name,) for name in judgement.forgotten])
                self._folding.fold(connection, self._lanes)
                self._save(connection)
            self._memory.apply(judgement)
            return len(judgement.fresh)

    def cut(self, lane: Lane, most_bytes: int) -> Cut | None:
        """The next records of a lane as a batch of about `most_bytes` at most; None when nothing waits.

        A stored batch that cannot be read is put into quarantine, counted, and passed over.
        """
        while True:
            found = self._look(lane, most_bytes)
            if not isinstance(found, Damage):
                return found
            self._quarantine(lane, found)

    def acknowledge(self, lane: Lane, through: int) -> int:
        """Let go of everything up to and with `through`; how many records that were.

        A number that this spool has never given means that it is older than it seems (restored
        from a copy): it takes a new id, for its numbers would be taken for repetitions.
        """
        with self._guarded() as connection:
            totals = self._lanes[lane]
            if through >= totals.next:
                self._renew(connection)
                return 0
            with table.transaction(connection):
                gone = table.let_go(connection, lane, totals, through)
                self._save(connection)
            self._refusing = self._refusing and not gone
            return gone

    def newest(self) -> dict[Lane, int]:
        """Number of the newest record of each lane; -1 before the first. Never waits."""
        return {lane: totals.next - 1 for lane, totals in self._lanes.items()}

    def newest_heard(self, key: str, source: str, boot_id: str) -> int:
        """Newest number ever taken of a stream; -1 for none. Never waits."""
        return self._memory.newest(key, source, boot_id)

    @property
    def new(self) -> bool:
        """Nothing has ever been taken."""
        return not self._memory

    def waiting(self) -> dict[Lane, int]:
        """Records of each lane that wait. Never waits itself."""
        return {lane: totals.records for lane, totals in self._lanes.items()}

    def dropped(self, lane: Lane) -> int:
        """Records of a lane dropped since the spool was made. Never waits."""
        return self._lanes[lane].dropped

    def held(self) -> Held:
        """What waits; waits itself while a commit is under way."""
        with self._lock:
            oldest: list[int] = []
            with suppress(SpoolFaultError), self._guarded() as connection:
                for lane in LANES:
                    row = connection.execute(
                        "SELECT oldest_ns FROM batch WHERE lane = ? ORDER BY first LIMIT 1", (lane,)
                    ).fetchone()
                    oldest += row or ()
            lanes = {lane: replace(totals) for lane, totals in self._lanes.items()}
            return Held(lanes, min(oldest, default=None), self._quarantined, self.cap_bytes, self._refusing)

    def tidy(self) -> None:
        """Give a little of what is free back to the file system; to be called once in a while."""
        with self._guarded() as connection:
            if connection.execute("PRAGMA freelist_count").fetchone()[0] > TIDY_FROM_PAGES:
                # A script, for `execute` would take one step only, which frees one page.
                connection.executescript(f"PRAGMA incremental_vacuum({TIDY_PAGES})")

    @contextmanager
    def _guarded(self) -> Iterator[sqlite3.Connection]:
        """The connection, for one caller at a time; the disk's faults become SpoolFaultError."""
        with self._lock:
            if self._held is None:
                msg = "the spool is closed"
                raise SpoolFaultError(msg)
            try:
                if self._connection is None:
                    self._open()
                assert self._connection is not None  # noqa: S101 - `_open` has just set it
                yield self._connection
            except sqlite3.Error as error:
                told = str(error)
                if table.is_damage(error):
                    self._recover()
                    told = f"{error}; {self.notes[-1]}"
                elif self._connection is not None:
                    self._reload(self._connection)
                raise SpoolFaultError(told) from error
            except OSError as error:
                raise SpoolFaultError(str(error)) from error

    def _open(self) -> None:
        if self._connection is not None:
            return
        if not self.path.exists() and (asides := rescue_store.asides(self.path)):
            self.notes.append(str(rescue_store.rescue(asides[-1], self.path, _new_id())))
        connection = table.connect(self.path)
        try:
            if table.is_empty(connection):
                table.create(connection, _new_id())
            self._connection = connection
            self._load(connection)
        except sqlite3.Error:
            self._connection = None
            connection.close()
            raise

    def _load(self, connection: sqlite3.Connection) -> None:
        known = table.meta(connection)
        self.spool_id = str(known["spool_id"])
        self._quarantined = int(known["quarantined"])
        self._lanes = table.totals(connection)
        self._folding = Folder()
        self._memory = Deduplication()
        self._memory.restore(
            StateRow(*row) for row in connection.execute("SELECT name, state, used FROM heard").fetchall()
        )

    def _reload(self, connection: sqlite3.Connection) -> None:
        """Go back to what the disk has, after a transaction that failed."""
        with suppress(sqlite3.Error):
            self._load(connection)

    def _recover(self) -> None:
        if self._connection is not None:
            with suppress(sqlite3.Error):
                self._connection.close()
            self._connection = None
        told = rescue_store.rescue(rescue_store.put_aside(self.path), self.path, _new_id())
        self.notes.append(str(told))
        self._open()

    def _save(self, connection: sqlite3.Connection) -> None:
        table.save_totals(connection, self._lanes)
        connection.execute("UPDATE meta SET value = ? WHERE name = 'quarantined'", (self._quarantined,))

    def _renew(self, connection: sqlite3.Connection) -> None:
        new_id = _new_id()
        with table.transaction(connection):
            connection.execute("UPDATE meta SET value = ? WHERE name = 'spool_id'", (new_id,))
        self.spool_id = new_id
        self.notes.append("the far end knows more of this spool than it holds itself: it goes on under a new id")

    def _fitting(self, lane: Lane, records: Sequence[BridgedRecord]) -> Iterator[BridgedRecord]:
        """Records of a lane that a batch can hold; others are counted as dropped."""
        for record in records:
            if lane_of(record.key) == lane:
                if len(record.payload) + len(record.key) + len(record.attachment) <= MOST_RECORD_BYTES:
                    yield record
                else:
                    self._lanes[lane].dropped += 1
                    self.notes.append(f"{len(record.payload)} bytes on {record.key} are too large to be bridged")

    def _append(self, connection: sqlite3.Connection, lane: Lane, chunk: list[BridgedRecord]) -> None:
        body = packed(chunk)
        totals = self._lanes[lane]
        if not self._make_room(connection, cost(len(body))):
            totals.dropped += len(chunk)
            self._refusing = self._refusing or lane == "events"
            return
        if lane == "events":
            self._refusing = False
        heard = [record.heard_ns for record in chunk]
        number = table.insert(connection, totals, Row(0, lane, totals.next, len(chunk), min(heard), max(heard), body))
        self._folding.note(lane, number, len(body))

    def _make_room(self, connection: sqlite3.Connection, wanted: int) -> bool:
        """Drop the oldest bulk until `wanted` bytes fit below the cap; False when they do not."""
        while sum(totals.bytes for totals in self._lanes.values()) + wanted > self.cap_bytes:
            if not table.drop_oldest(connection, "bulk", self._lanes["bulk"]):
                return False
        return True

    def _look(self, lane: Lane, most_bytes: int) -> Cut | Damage | None:
        with self._guarded() as connection:
            through = self._lanes[lane].through
            stored: list[Piece] = []
            size = 0
            for first, count, oldest, newest, body in connection.execute(
                "SELECT first, count, oldest_ns, newest_ns, body FROM batch WHERE lane = ? ORDER BY first LIMIT ?",
                (lane, READ_ROWS),
            ):
                stored.append(Piece(first, count, oldest, newest, body))
                size += len(body)
                if size > most_bytes:
                    break
            spool_id = self.spool_id
        return cut_of(stored, through, most_bytes, spool_id)

    def _quarantine(self, lane: Lane, damage: Damage) -> None:
        with self._guarded() as connection, table.transaction(connection):
            gone = table.put_into_quarantine(connection, lane, self._lanes[lane], damage.first, damage.reason)
            self._quarantined += gone
            self._save(connection)
        self.notes.append(f"{gone} records of the lane {lane} cannot be read and are in quarantine: {damage.reason}")


def _new_id() -> str:
    return secrets.token_hex(8)
