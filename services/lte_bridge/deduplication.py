"""What a far end has already had: by number in the sender's spool, and by source, boot id and sequence.

A batch that was committed but whose acknowledgement was lost comes again, perhaps cut otherwise,
so every receiver keeps this beside what it stores:

    memory = Deduplication()
    memory.restore(rows of the table)                 # at start, least recently used first
    records = unpacked(batch.compressed, batch.count) # services/lte_bridge/batch.py
    judgement = memory.judge(batch, records)
    …one transaction: store judgement.fresh, upsert judgement.rows by name, delete judgement.forgotten, commit…
    memory.apply(judgement)                           # only once committed
    answer BridgeAcknowledgement(through=judgement.through, repeated=judgement.repeated, …)

One batch at a time: what `judge` finds holds until the next `apply`. When the transaction fails
nothing is applied, nothing is answered but a refusal, and the batch comes again.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import msgspec

from schemas.bridge import BridgeBatch, BridgedRecord

MOST_STREAMS = 20_000
"""Streams (key, source and boot id) and spool lanes that are remembered; the least recently used goes first."""
MOST_SPANS = 64
"""Stretches of sequence numbers kept of one stream; then the two oldest count as one, gap and all."""
_SEPARATOR = "\n"


class Mark(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The part of an attachment by which publications are told apart."""

    source: str
    boot_id: str
    sequence: int


@dataclass(frozen=True, slots=True)
class StateRow:
    """What is remembered of one stream or spool lane, as a store keeps it under its name."""

    name: str
    state: bytes
    used: int
    """Counts uses; rows are restored in this order."""


@dataclass(slots=True)
class Spans:
    """Sequence numbers that were had, as closed stretches in rising order.

    >>> spans = Spans()
    >>> [spans.add(number) for number in (3, 4, 7, 4, 5)]
    [True, True, True, False, True]
    >>> spans.firsts, spans.lasts
    ([3, 7], [5, 7])
    """

    firsts: list[int] = field(default_factory=list)
    lasts: list[int] = field(default_factory=list)

    def add(self, number: int) -> bool:
        """Take a number in; False when it was had before (or lies in a gap long given up)."""
        firsts, lasts = self.firsts, self.lasts
        if lasts and number == lasts[-1] + 1:
            lasts[-1] = number
            return True
        at = bisect_right(firsts, number)
        if at and number <= lasts[at - 1]:
            return False
        joins_before = at > 0 and lasts[at - 1] + 1 == number
        joins_after = at < len(firsts) and firsts[at] == number + 1
        if joins_before and joins_after:
            lasts[at - 1] = lasts.pop(at)
            del firsts[at]
        elif joins_before:
            lasts[at - 1] = number
        elif joins_after:
            firsts[at] = number
        else:
            firsts.insert(at, number)
            lasts.insert(at, number)
            if len(firsts) > MOST_SPANS:
                del firsts[1]
                del lasts[0]
        return True

    def copy(self) -> Spans:
        """Spans of their own."""
        return Spans(self.firsts.copy(), self.lasts.copy())


@dataclass(frozen=True, slots=True)
class Judgement:
    """What of a batch is new, and what is to be remembered with it."""

    fresh: tuple[BridgedRecord, ...]
    """In the order of the batch."""
    repeated: int
    through: int
    """To be acknowledged: the last number of the lane that is had."""
    rows: tuple[StateRow, ...]
    """To be kept in the same transaction as `fresh`."""
    forgotten: tuple[str, ...]
    """Names of rows to be deleted."""
    touched: dict[str, Spans]


class Deduplication:
    """Remembers what was had; bounded in memory."""

    def __init__(self, most_streams: int = MOST_STREAMS) -> None:
        """Remember nothing yet."""
        self._most = most_streams
        self._spans: dict[str, Spans] = {}
        self._used = 0

    def restore(self, rows: Iterable[StateRow]) -> None:
        """Take in what a store has kept; in any order. A state that is none is left out."""
        for row in sorted(rows, key=lambda row: row.used):
            try:
                ends = msgspec.msgpack.decode(row.state, type=list[int])
            except (msgspec.MsgspecError, ValueError):
                continue
            if len(ends) % 2 == 0:
                self._spans[row.name] = Spans(ends[::2], ends[1::2])
                self._used = max(self._used, row.used)

    def judge(self, batch: BridgeBatch, records: Sequence[BridgedRecord]) -> Judgement:
        """What of a batch's records is new; `records` as `unpacked` gives them, one for each number."""
        lane = _SEPARATOR.join(("lane", batch.bridge, batch.spool_id, batch.lane))
        had = self._spans.get(lane)
        through = had.lasts[-1] if had and had.lasts else batch.first - 1
        unseen = records[max(0, through + 1 - batch.first) :]
        fresh, touched = self._sieve(unseen)
        last = max(through, batch.first + batch.count - 1)
        touched[lane] = Spans([0], [last])
        return self._judgement(tuple(fresh), len(records) - len(fresh), last, touched)

    def judge_heard(self, records: Sequence[BridgedRecord]) -> Judgement:
        """What is new of records that come without number, from a bus that may say things again."""
        fresh, touched = self._sieve(records)
        return self._judgement(tuple(fresh), len(records) - len(fresh), 0, touched)

    def newest(self, key: str, source: str, boot_id: str) -> int:
        """Newest number had of a stream; -1 for none."""
        spans = self._spans.get(_SEPARATOR.join((key, source, boot_id)))
        return spans.lasts[-1] if spans and spans.lasts else -1

    def __bool__(self) -> bool:
        """Whether anything was ever had."""
        return bool(self._spans)

    def apply(self, judgement: Judgement) -> None:
        """Remember a judgement whose transaction has been committed."""
        for name, spans in judgement.touched.items():
            self._spans.pop(name, None)
            self._spans[name] = spans
        for name in judgement.forgotten:
            del self._spans[name]
        self._used += len(judgement.rows)

    def _sieve(self, records: Sequence[BridgedRecord]) -> tuple[list[BridgedRecord], dict[str, Spans]]:
        fresh: list[BridgedRecord] = []
        streams: dict[tuple[str, str, str], Spans] = {}
        for record in records:
            mark = _mark(record.attachment)
            if mark is None:  # told apart by its number alone
                fresh.append(record)
                continue
            stream = (record.key, mark.source, mark.boot_id)
            spans = streams.get(stream)
            if spans is None:
                known = self._spans.get(_SEPARATOR.join(stream))
                spans = streams[stream] = known.copy() if known else Spans()
            if spans.add(mark.sequence):
                fresh.append(record)
        return fresh, {_SEPARATOR.join(stream): spans for stream, spans in streams.items()}

    def _judgement(
        self, fresh: tuple[BridgedRecord, ...], repeated: int, through: int, touched: dict[str, Spans]
    ) -> Judgement:
        rows = tuple(
            StateRow(name, _state(spans), self._used + number)
            for number, (name, spans) in enumerate(touched.items(), start=1)
        )
        surplus = len(self._spans) + sum(name not in self._spans for name in touched) - self._most
        forgotten: list[str] = []
        for name in self._spans if surplus > 0 else ():
            if len(forgotten) == surplus:
                break
            if name not in touched:
                forgotten.append(name)
        return Judgement(fresh, repeated, through, rows, tuple(forgotten), touched)


_MARKS = msgspec.msgpack.Decoder(Mark)


def _mark(attachment: bytes) -> Mark | None:
    """Source, boot id and sequence; None where a foreign sender set none."""
    try:
        mark = _MARKS.decode(attachment)
    except (msgspec.MsgspecError, ValueError, OverflowError, RecursionError):
        return None
    return mark if mark.sequence >= 0 else None


def _state(spans: Spans) -> bytes:
    return msgspec.msgpack.encode([end for pair in zip(spans.firsts, spans.lasts, strict=True) for end in pair])
