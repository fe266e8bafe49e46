"""A damaged spool is put aside, and what can be read of it is saved into a new one."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from services.lte_bridge.batch import BatchError, packed, pieces
from services.lte_bridge.lane import LANES, Lane
from services.lte_bridge.spool_table_store import (
    COLUMNS,
    LaneTotals,
    Row,
    connect,
    create,
    insert,
    save_totals,
    totals,
    transaction,
)

_PAGE_ONE_BYTES = 4096
_PAGES_AT, _FREE_AT, _VACUUM_AT = 28, 32, 52
"""Offsets in SQLite's file header (file format, section 1.3)."""


@dataclass(frozen=True, slots=True)
class Rescue:
    """What became of a damaged spool."""

    aside: Path
    saved: int
    """Records."""
    lost: int | None
    """Records; None where not even the totals could be read."""

    def __str__(self) -> str:
        """For people."""
        lost = "how many more it held is unknown" if self.lost is None else f"{self.lost} lost"
        return f"a damaged spool was put aside as {self.aside}: {self.saved} records saved, {lost}"


def put_aside(spool: Path) -> Path:
    """Rename a damaged spool with what belongs to it; its new path."""
    number = 1 + max((_number(path) for path in asides(spool)), default=0)
    aside = spool.with_name(f"{spool.stem}.damaged-{number}{spool.suffix}")
    for ending in ("-wal", "-shm"):
        with suppress(FileNotFoundError):
            Path(f"{spool}{ending}").rename(f"{aside}{ending}")
    spool.rename(aside)
    return aside


def asides(spool: Path) -> list[Path]:
    """Damaged spools that were put aside, oldest first."""
    found = spool.parent.glob(f"{spool.stem}.damaged-*{spool.suffix}")
    return sorted((path for path in found if _number(path)), key=_number)


def _number(path: Path) -> int:
    text = path.stem.rpartition("-")[2]
    return int(text) if text.isdecimal() else 0


def rescue(aside: Path, spool: Path, spool_id: str) -> Rescue:
    """Save what can be read of `aside` into a new spool, which appears whole or not at all.

    Records keep their order; those acknowledged are left out where the totals could be read.
    """
    part = Path(f"{spool}.part")
    for ending in ("", "-wal", "-shm", "-journal"):
        Path(f"{part}{ending}").unlink(missing_ok=True)
    with closing(connect(part)) as new, closing(_opened(aside)) as old:
        new.execute("PRAGMA journal_mode = OFF")  # a rescue that is cut short begins anew
        create(new, spool_id)
        before = _totals_of(old)
        lanes: dict[Lane, LaneTotals] = {lane: LaneTotals() for lane in LANES}
        with transaction(new):
            for row in _readable(old):
                kept = _unacknowledged(row, before[row.lane].through if before else -1)
                if kept is not None:
                    insert(new, lanes[row.lane], kept)
            for lane in LANES:
                lanes[lane].dropped = before[lane].dropped if before else 0
            saved = sum(total.records for total in lanes.values())
            lost = max(0, sum(total.records for total in before.values()) - saved) if before else None
            save_totals(new, lanes)
            new.execute("UPDATE meta SET value = ? WHERE name = 'quarantined'", (_quarantined(old) + (lost or 0),))
            new.executemany("INSERT OR IGNORE INTO heard VALUES (?, ?, ?)", _heard(old))
    part.rename(spool)
    _sync_folder(spool.parent)
    return Rescue(aside, saved, lost)


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _opened(aside: Path) -> sqlite3.Connection:
    """Connection to a damaged file; one whose first page is lost is given that of a new spool."""
    old = sqlite3.connect(aside, isolation_level=None)
    old.text_factory = lambda octets: octets.decode("utf-8", "replace")
    try:
        old.execute("SELECT count(*) FROM sqlite_schema").fetchone()
        old.execute("SELECT 1 FROM batch LIMIT 0")
    except sqlite3.Error:
        old.close()
        _give_first_page(aside)
        old = sqlite3.connect(aside, isolation_level=None)
        old.text_factory = lambda octets: octets.decode("utf-8", "replace")
    return old


def _give_first_page(aside: Path) -> None:
    """Replace the first page, which says where the tables begin: that is the same in every spool."""
    model = Path(f"{aside}.model")
    model.unlink(missing_ok=True)
    with closing(connect(model)) as made:
        create(made, "model")
        made.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    page = bytearray(model.read_bytes()[:_PAGE_ONE_BYTES])
    model.unlink()
    page[_PAGES_AT : _PAGES_AT + 4] = (aside.stat().st_size // _PAGE_ONE_BYTES).to_bytes(4, "big")
    page[_FREE_AT : _FREE_AT + 8] = bytes(8)  # no list of free pages: they are not needed for reading
    with aside.open("r+b") as file:
        file.write(page)


def _totals_of(old: sqlite3.Connection) -> dict[Lane, LaneTotals] | None:
    try:
        return totals(old)
    except (sqlite3.Error, TypeError):
        return None


def _quarantined(old: sqlite3.Connection) -> int:
    try:
        return int(old.execute("SELECT value FROM meta WHERE name = 'quarantined'").fetchone()[0])
    except (sqlite3.Error, TypeError, ValueError):
        return 0


def _heard(old: sqlite3.Connection) -> Iterator[tuple[str, bytes, int]]:
    with suppress(sqlite3.Error):
        for name, state, used in old.execute("SELECT name, state, used FROM heard"):
            if isinstance(name, str) and isinstance(state, bytes) and isinstance(used, int):
                yield name, state, used


def _ids(old: sqlite3.Connection) -> list[int]:
    """Every id that table or index still tell, from both ends up to what is broken."""
    found: set[int] = set()
    for query in ("SELECT id FROM batch NOT INDEXED ORDER BY id", "SELECT id FROM batch ORDER BY lane, first"):
        for direction in ("", " DESC"):
            ordered = query.replace(", first", f"{direction}, first") + direction
            with suppress(sqlite3.Error):
                for (number,) in old.execute(ordered):
                    found.add(number)
    return sorted(found)


def _readable(old: sqlite3.Connection) -> Iterator[Row]:
    """Rows in order of their ids, which is that of their numbers within a lane unless they were folded."""
    rows: list[tuple[str, int, int]] = []
    for number in _ids(old):
        with suppress(sqlite3.Error, TypeError):  # TypeError: the index tells of a row that the table has not
            lane, first = old.execute("SELECT lane, first FROM batch WHERE id = ?", (number,)).fetchone()
            if lane in LANES and isinstance(first, int):
                rows.append((lane, first, number))
    for _, _, number in sorted(rows):
        try:
            row = Row(*old.execute(f"SELECT {COLUMNS} FROM batch WHERE id = ?", (number,)).fetchone())  # noqa: S608 - our own columns
            pieces(row.body, row.count)
        except (sqlite3.Error, BatchError, TypeError):
            continue
        yield row


def _unacknowledged(row: Row, through: int) -> Row | None:
    """The part of a row that waits for its acknowledgement."""
    done = through + 1 - row.first
    if done <= 0:
        return row
    left = pieces(row.body, row.count)[done:]
    return replace(row, first=row.first + done, count=len(left), body=packed(left)) if left else None
