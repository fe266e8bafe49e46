"""From a bridge's batch to one commit: unpacked, told apart from what was had, turned into rows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from schemas.bridge import BridgeAcknowledgement, BridgeBatch
from services.cloud_analyzer.history import Commit
from services.cloud_analyzer.tables import LATE_DAYS, rows_of
from services.lte_bridge.batch import unpacked
from services.lte_bridge.deduplication import Deduplication, Judgement, StateRow

CLOCK_OFF_NS = 300 * 1_000_000_000
"""A batch waits no longer than this for its answer: a bridge whose time lies farther from ours has a wrong clock."""
PLACE_PARTS = 3
"""Line, kind and name stand before the instance in a bridge's name."""


@dataclass(frozen=True, slots=True)
class Taken:
    """What is to be committed for a batch, and what is answered once it is."""

    commit: Commit
    judgement: Judgement
    acknowledgement: BridgeAcknowledgement
    ahead_ns: int = 0
    """Of the bridge's clock, where it is off; its times were set right by it."""


class Ingest:
    """Takes batches, one at a time: what `take` gives is to be committed and `confirm`ed, or dropped."""

    def __init__(
        self,
        line: str,
        had: Iterable[StateRow],
        relays: frozenset[str] = frozenset(),
        late_days: float = LATE_DAYS,
    ) -> None:
        """Begin with what a store remembers.

        `relays`: places whose bridges may speak for any place of the line. Times more than `late_days` before they
        were heard are not believed.
        """
        self._late_days = late_days
        self._line = line
        self._relays = relays
        self._had = Deduplication()
        self._had.restore(had)

    def take(self, batch: BridgeBatch, now_ns: int) -> Taken:
        """Rows of what is new in a batch. Raises BatchError for bytes that are none, ValueError for a foreign line."""
        place = "/".join(batch.bridge.split("/")[:PLACE_PARTS])
        if not place.startswith(f"{self._line}/"):
            msg = f"{batch.bridge} is no bridge of line {self._line}"
            raise ValueError(msg)
        records = unpacked(batch.compressed, batch.count)
        judgement = self._had.judge(batch, records)
        allowed = None if place in self._relays else frozenset({place})
        # A batch is stamped when it is sent: what is more than its way here is the bridge's clock.
        off_ns = batch.t_ns - now_ns
        ahead_ns = off_ns if abs(off_ns) > CLOCK_OFF_NS else 0
        rows = rows_of(judgement.fresh, now_ns, allowed, self._late_days, ahead_ns)
        refused = {row[1] for row in rows.refused}
        outbox = tuple(record for record in judgement.fresh if not refused or record.key not in refused)
        commit = Commit(rows, judgement.rows, judgement.forgotten, outbox)
        acknowledgement = BridgeAcknowledgement(
            t_ns=now_ns,
            bridge=batch.bridge,
            lane=batch.lane,
            spool_id=batch.spool_id,
            through=judgement.through,
            repeated=judgement.repeated,
            refused=len(rows.refused),
        )
        return Taken(commit, judgement, acknowledgement, ahead_ns)

    def confirm(self, taken: Taken) -> None:
        """Remember what has been committed."""
        self._had.apply(taken.judgement)
