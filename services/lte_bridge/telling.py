"""How a bridge is doing: its status, and the reasons for its health in words."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from schemas.bridge import BridgeStatus
from schemas.health import Level
from services.lte_bridge.filling import Filling
from services.lte_bridge.lane import LANES, Lane
from services.lte_bridge.spool_table_store import LaneTotals

DROPPED_SHOWN_S = 600.0
"""Drops are a reason for health for so long; they are counted for ever."""
LINKED_S = 10.0
"""The far end counts as linked this long after its last acknowledgement."""


@dataclass(frozen=True, slots=True)
class Held:
    """What a spool holds at a moment."""

    lanes: dict[Lane, LaneTotals]
    oldest_ns: int | None
    quarantined: int
    cap_bytes: int
    full_of_events: bool
    """New events are being refused."""

    @property
    def records(self) -> int:
        """Waiting in both lanes."""
        return sum(totals.records for totals in self.lanes.values())

    @property
    def bytes(self) -> int:
        """Waiting in both lanes, compressed."""
        return sum(totals.bytes for totals in self.lanes.values())


@dataclass(slots=True)
class Progress:
    """What has gone well and badly on the way to the far end. Times are monotonic."""

    linked_s: float
    """When the far end last acknowledged something, or nothing waited."""
    acknowledged: int = 0
    delays: dict[Lane, float | None] = field(default_factory=lambda: dict.fromkeys(LANES))
    faults: dict[Lane, str] = field(default_factory=dict)
    """Why the last attempt of a lane had no success."""
    _filling: Filling = field(default_factory=Filling)
    _dropped: int | None = None
    _dropped_s: float = -math.inf
    """When the number of drops last grew."""

    def succeeded(self, lane: Lane, records: int, delay_s: float, now_s: float) -> None:
        """Take note of an acknowledgement."""
        self.acknowledged += records
        self.delays[lane] = max(0.0, delay_s)
        self.linked_s = now_s
        self.faults.pop(lane, None)

    def status(self, held: Held, unspooled: dict[Lane, int], t_ns: int, now_s: float) -> BridgeStatus:
        """Status message; `unspooled` are drops that the spool does not know of yet."""
        self._filling.note(now_s, held.bytes)
        if not held.records:
            self.linked_s = now_s
        dropped = held.lanes["bulk"].dropped + unspooled["bulk"]
        if self._dropped is not None and dropped > self._dropped:
            self._dropped_s = now_s
        self._dropped = dropped
        return BridgeStatus(
            t_ns=t_ns,
            linked=now_s - self.linked_s < LINKED_S,
            backlog_records=held.records,
            backlog_bytes=held.bytes,
            cap_bytes=held.cap_bytes,
            oldest_ns=held.oldest_ns,
            delay_events_s=self.delays["events"],
            delay_bulk_s=self.delays["bulk"],
            acknowledged=self.acknowledged,
            dropped_bulk=dropped,
            dropped_events=held.lanes["events"].dropped + unspooled["events"],
            quarantined=held.quarantined,
            full_in_s=self._filling.full_in_s(now_s, held.bytes, held.cap_bytes),
        )

    def reasons(self, held: Held, told: BridgeStatus, now_s: float) -> dict[str, tuple[Level, str] | None]:
        """For health: level and words by name, None for what is well."""
        why = "; ".join(sorted(set(self.faults.values()))) or "no router answers at the far end"
        since_s = now_s - self.linked_s
        return {
            "link": None
            if told.linked
            else ("degraded", f"{told.backlog_records} records wait, none acknowledged for {since_s:.0f} s: {why}"),
            "full": ("failed", f"the spool is full of events: {told.dropped_events} dropped so far")
            if held.full_of_events
            else None,
            "dropped": ("degraded", f"dropping the oldest bulk: {told.dropped_bulk} since the spool was made")
            if now_s - self._dropped_s < DROPPED_SHOWN_S
            else None,
        }


def counts(told: BridgeStatus) -> dict[str, int]:
    """Counters for health."""
    return {
        "backlog": told.backlog_records,
        "backlog_kb": told.backlog_bytes // 1000,
        "acknowledged": told.acknowledged,
        "dropped_bulk": told.dropped_bulk,
        "dropped_events": told.dropped_events,
        "quarantined": told.quarantined,
        "delay_events_ms": round(1000.0 * (told.delay_events_s or 0.0)),
        "delay_bulk_ms": round(1000.0 * (told.delay_bulk_s or 0.0)),
    }
