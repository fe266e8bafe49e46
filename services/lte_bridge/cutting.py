"""How stored batches become one batch for the link: as large as the link takes in good time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import msgspec

from schemas.codec import MAX_MESSAGE_BYTES
from services.lte_bridge.batch import BatchError, heard_ns, packed, pieces

MOST_WIRE_BYTES = MAX_MESSAGE_BYTES - 4 * 1024
"""No batch is larger, for no receiver would take it."""
MOST_CUT_PLAIN_BYTES = 4 * 1024 * 1024
FULL_ENOUGH = 0.5
"""A stored batch at least so full is sent as it is."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A stored batch; its records are numbered from `first` on."""

    first: int
    count: int
    oldest_ns: int
    newest_ns: int
    body: bytes


@dataclass(frozen=True, slots=True)
class Cut:
    """A batch for the link."""

    spool_id: str
    first: int
    count: int
    compressed: bytes
    newest_ns: int
    """When its last record was heard."""

    @property
    def last(self) -> int:
        """Number of its last record."""
        return self.first + self.count - 1


@dataclass(frozen=True, slots=True)
class Damage:
    """The stored batch that begins at `first` cannot be read."""

    first: int
    reason: str


def cut_of(stored: Sequence[Piece], through: int, most_bytes: int, spool_id: str) -> Cut | Damage | None:
    """Batch of about `most_bytes` at most from the first stored ones; at least one record.

    Records up to and with number `through` are left out; where numbers are missing the batch ends.
    """
    stored = [piece for piece in stored if piece.first + piece.count - 1 > through]
    if not stored:
        return None
    head = stored[0]
    whole = head.first > through and FULL_ENOUGH * most_bytes <= len(head.body) <= most_bytes
    gathered: list[msgspec.Raw] = []
    size = plain = 0.0
    first = next_number = max(head.first, through + 1)
    for piece in stored:
        if gathered and (piece.first != next_number or size >= most_bytes or plain >= MOST_CUT_PLAIN_BYTES):
            break
        try:
            found = pieces(piece.body, piece.count)
        except BatchError as error:
            if gathered:
                break
            return Damage(piece.first, str(error))
        if whole:
            return Cut(spool_id, head.first, head.count, head.body, head.newest_ns)
        each = len(piece.body) / piece.count
        skipped = next_number - piece.first
        room = max(0 if gathered else 1, int((most_bytes - size) / each))
        taken = found[skipped : skipped + room]
        gathered += taken
        size += each * len(taken)
        plain += sum(map(len, taken))
        next_number += len(taken)
        if skipped + len(taken) < piece.count:
            break
    return _fitted(spool_id, first, gathered, most_bytes)


def _fitted(spool_id: str, first: int, gathered: list[msgspec.Raw], most_bytes: int) -> Cut:
    """Cut of the records gathered, less those that turn out not to fit once compressed together."""
    most = min(2 * most_bytes, MOST_WIRE_BYTES)
    while len(compressed := packed(gathered)) > most and len(gathered) > 1:
        gathered = gathered[: max(1, int(0.8 * len(gathered) * most / len(compressed)))]
    return Cut(spool_id, first, len(gathered), compressed, heard_ns(gathered[-1]))
