"""Small stored batches are folded into larger ones while they wait: a third of the room, and fewer rows.

At a few records a second every commit makes a batch of its own, which hardly compresses. Of
thirty-two such batches one is made, of thirty-two of those again one, in the transaction that
appends the next.
"""

from __future__ import annotations

import sqlite3
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise

from services.lte_bridge.batch import BatchError, packed, pieces
from services.lte_bridge.lane import Lane
from services.lte_bridge.spool_table_store import LaneTotals, cost

FOLD = 32
SMALL_BYTES = 16 * 1024
"""Larger batches stay as they are."""
MOST_PLAIN_BYTES = 1024 * 1024
LEVELS = 3


@dataclass(slots=True)
class Folder:
    """Remembers the small batches of this run; those of earlier runs stay as they are."""

    _small: defaultdict[tuple[Lane, int], list[int]] = field(default_factory=lambda: defaultdict(list))

    def note(self, lane: Lane, number: int, size: int) -> None:
        """Take note of a batch that was appended."""
        if size < SMALL_BYTES:
            self._small[lane, 0].append(number)
        else:
            self._small.clear()  # what lies on both sides of a large one cannot become one

    def fold(self, connection: sqlite3.Connection, lanes: dict[Lane, LaneTotals]) -> None:
        """Fold what has gathered, within the transaction of whoever appended."""
        for level in range(LEVELS):
            for lane, totals in lanes.items():
                ids = self._small[lane, level]
                if len(ids) >= FOLD:
                    del self._small[lane, level]
                    made = _fold(connection, lane, totals, ids)
                    if made is not None and level + 1 < LEVELS:
                        self._small[lane, level + 1].append(made)


def _fold(connection: sqlite3.Connection, lane: Lane, totals: LaneTotals, ids: list[int]) -> int | None:
    """Id of the one batch made of those that are still there; None when they cannot become one."""
    marks = ",".join("?" * len(ids))
    # The lane as well: a batch that has gone leaves its id to the next one, of whichever lane.
    rows = connection.execute(
        f"SELECT first, count, oldest_ns, newest_ns, body, id FROM batch WHERE lane = ? AND id IN ({marks}) "  # noqa: S608 - question marks
        "ORDER BY first",
        [lane, *ids],
    ).fetchall()
    if len(rows) <= 1 or any(a[0] + a[1] != b[0] for a, b in pairwise(rows)):
        return None
    try:
        gathered = [piece for _, count, _, _, body, _ in rows for piece in pieces(body, count)]
    except BatchError:  # found out again, and counted, when it is to be sent
        return None
    if sum(map(len, gathered)) > MOST_PLAIN_BYTES:
        return None
    body = packed(gathered)
    connection.executemany("DELETE FROM batch WHERE id = ?", [(row[5],) for row in rows])
    cursor = connection.execute(
        "INSERT INTO batch(lane, first, count, oldest_ns, newest_ns, body) VALUES (?, ?, ?, ?, ?, ?)",
        (lane, rows[0][0], len(gathered), min(row[2] for row in rows), max(row[3] for row in rows), body),
    )
    totals.bytes += cost(len(body)) - sum(cost(len(row[4])) for row in rows)
    return cursor.lastrowid if len(body) < SMALL_BYTES else None
