"""Whose turn it is, and whether an answer fits the batch it answers."""

from __future__ import annotations

from dataclasses import dataclass, field

from schemas.bridge import BridgeAcknowledgement, BridgeBatch
from services.lte_bridge.cutting import Cut
from services.lte_bridge.lane import LANES, Lane


@dataclass(slots=True)
class Turns:
    """Lets bulk go only while no event waits to be taken along.

    An event that is on its way holds up nothing: else a trickle of events would stop bulk for
    ever. Nor do events that pause after a vain attempt.
    """

    _under_way: dict[Lane, int] = field(default_factory=lambda: dict.fromkeys(LANES, -1))
    _pausing: dict[Lane, bool] = field(default_factory=lambda: dict.fromkeys(LANES, False))

    def goes(self, lane: Lane, last: int) -> None:
        """A batch up to and with number `last` is on its way."""
        self._under_way[lane] = last

    def pauses(self, lane: Lane, *, pausing: bool) -> None:
        """A lane waits after a vain attempt, or no longer does; what was on its way is to be sent again."""
        self._pausing[lane] = pausing
        self._under_way[lane] = -1

    def may_go(self, lane: Lane, waiting: dict[Lane, int], newest: dict[Lane, int]) -> bool:
        """Whether a lane has something to send now, given how many records wait and the newest number of each lane."""
        if not waiting[lane]:
            return False
        return (
            lane == "events"
            or not waiting["events"]
            or newest["events"] <= self._under_way["events"]
            or self._pausing["events"]
        )


def fault_of(batch: BridgeBatch, answer: BridgeAcknowledgement) -> str | None:
    """Why an answer does not acknowledge a batch; None when it does."""
    if (answer.bridge, answer.lane, answer.spool_id) != (batch.bridge, batch.lane, batch.spool_id):
        return f"the far end acknowledged the {answer.lane} of {answer.bridge} ({answer.spool_id}), not what was sent"
    if answer.through < batch.first:
        return f"the far end acknowledged up to {answer.through}, less than the batch from {batch.first} on"
    return None


def batch_of(cut: Cut, bridge: str, lane: Lane, dropped: int, t_ns: int) -> BridgeBatch:
    """What goes to the far end."""
    return BridgeBatch(
        t_ns=t_ns,
        bridge=bridge,
        lane=lane,
        spool_id=cut.spool_id,
        first=cut.first,
        count=cut.count,
        compressed=cut.compressed,
        dropped=dropped,
    )


def acknowledgement_of(
    batch: BridgeBatch, through: int, repeated: int, refused: int, t_ns: int
) -> BridgeAcknowledgement:
    """Answer to a batch that is durable."""
    return BridgeAcknowledgement(
        t_ns=t_ns,
        bridge=batch.bridge,
        lane=batch.lane,
        spool_id=batch.spool_id,
        through=through,
        repeated=repeated,
        refused=refused,
    )
