"""What a service keeps of its KEPT publications, in memory, bounded by age and bytes.

Zenoh's own cache counts publications: a thousand of a key last an hour or a twentieth of a second. Whoever
puts them on disk was perhaps away for longer; it asks for what it has missed (`RETAINED`).
"""

from __future__ import annotations

from collections import deque
from itertools import islice

from schemas.retention import RetainedAnswer, RetainedQuestion, RetainedRecord, Span

OVERHEAD_BYTES = 300
"""What a publication takes in memory beside payload and attachment, roughly."""
UNDER_WAY_S = 1.0
"""What was said later than that ago is no gap yet: it may be on its way to a reader."""
LOOK_S = 1.0
MOST_KEYS_LISTED = 4096
_Kept = tuple[int, float, bytes, bytes]
"""Sequence number, monotonic time, payload, attachment."""


class Retention:
    """Publications of one start of a service. Used from the loop's thread."""

    def __init__(self, boot_id: str, most_s: float, most_bytes: int) -> None:
        """Keep nothing yet."""
        self._boot_id = boot_id
        self._most_s = most_s
        self._most_bytes = most_bytes
        self._lines: dict[str, deque[_Kept]] = {}
        self._order: deque[deque[_Kept]] = deque()
        """The line of each publication kept, oldest first."""
        self._bytes = 0
        self._due_s = 0.0
        """When to look next for what is too old."""

    def keep(self, key: str, sequence: int, payload: bytes, attachment: bytes, now_s: float) -> None:
        """Keep one publication; those of a key come in the order of their numbers, without gap."""
        line = self._lines.get(key)
        if line is None:
            line = self._lines[key] = deque()
        line.append((sequence, now_s, payload, attachment))
        self._order.append(line)
        self._bytes += len(payload) + len(attachment) + OVERHEAD_BYTES
        if self._bytes > self._most_bytes or now_s >= self._due_s:
            self._let_go(now_s)

    def answer(self, question: RetainedQuestion, now_s: float, t_ns: int) -> RetainedAnswer:
        """What is wanted, as far as it is still kept."""
        self._let_go(now_s)
        wanted = question.wanted if question.boot_id == self._boot_id else {}
        keys = wanted or list(islice(self._lines, MOST_KEYS_LISTED))
        kept = {key: _span(line, now_s) for key in keys if (line := self._lines.get(key))}
        records: list[RetainedRecord] = []
        room = question.most_bytes
        more = False
        for key, (first, last) in wanted.items():
            line = self._lines.get(key)
            if not line:
                continue
            oldest = line[0][0]
            for _, _, payload, attachment in islice(line, max(0, first - oldest), max(0, last + 1 - oldest)):
                room -= len(payload) + len(attachment) + len(key)
                if room < 0 and records:
                    more = True
                    break
                records.append(RetainedRecord(key=key, payload=payload, attachment=attachment))
            if more:
                break
        return RetainedAnswer(t_ns=t_ns, boot_id=self._boot_id, kept=kept, records=tuple(records), more=more)

    def _let_go(self, now_s: float) -> None:
        self._due_s = now_s + LOOK_S
        order = self._order
        oldest_s = now_s - self._most_s
        while order and (self._bytes > self._most_bytes or order[0][0][1] < oldest_s):
            _, _, payload, attachment = order.popleft().popleft()
            self._bytes -= len(payload) + len(attachment) + OVERHEAD_BYTES


def _span(line: deque[_Kept], now_s: float) -> Span:
    """What a line has, without what may still be on its way."""
    last = next((number for number, at_s, _, _ in reversed(line) if at_s <= now_s - UNDER_WAY_S), line[0][0] - 1)
    return line[0][0], last
