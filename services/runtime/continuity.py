"""Publications in the order of their numbers; what is missing is noticed, and waited for.

Pure: who is asked for what is missing, and when it is given up, is told from outside
(services/runtime/catching_up.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import msgspec

from schemas.retention import Span
from services.runtime.node import Sample

MOST_STREAMS = 20_000
HELD_BYTES = 32 * 1024 * 1024
"""Of what waits for earlier publications; of more, all is forgotten and fetched again in its turn."""
Sender = tuple[str, str]
"""Source and boot id."""


class _Mark(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The part of an attachment that is needed here."""

    source: str
    boot_id: str
    sequence: int


_decode = msgspec.msgpack.Decoder(_Mark).decode


@dataclass(slots=True)
class _Stream:
    """Publications of one start of a sender on one key."""

    next: int
    """Number of the next publication."""
    told: bool
    """Whether what is missing before it counts as missed."""
    upto: int = -1
    """Publications up to this number are known to have been said."""
    held: dict[int, Sample] = field(default_factory=dict)
    """Those that came before their turn."""

    def gap(self) -> Span | None:
        """What is missing before the next one that is held or known of."""
        if self.whole:
            return None
        return self.next, min(self.held) - 1 if self.held else self.upto

    @property
    def whole(self) -> bool:
        """Nothing is missing: `upto` includes what is held."""
        return self.upto < self.next

    def run(self) -> list[Sample]:
        """What is held and has its turn now."""
        found = []
        while (sample := self.held.pop(self.next, None)) is not None:
            found.append(sample)
            self.next += 1
        return found


class Continuity:
    """Follows every sender on every key."""

    def __init__(self, newest: Callable[[str, str, str], int], *, told: bool) -> None:
        """Begin where a reader stands.

        `newest` gives the last number that it has of a key, source and boot id, -1 for none. `told`: what was said
        before the first number had counts as missed, because the reader has been there before.
        """
        self._newest = newest
        self._told = told
        self._streams: dict[tuple[str, str, str], _Stream] = {}
        self._held_bytes = 0
        self._open: dict[Sender, set[str]] = {}
        """Keys with a gap."""
        self.missed = 0
        """Publications that nobody keeps any more."""

    def offer(self, sample: Sample) -> Sequence[Sample]:
        """What may go on now that this has come: nothing while something before it is missing.

        A number that was had goes on as it is, and so does what its sender has not marked.
        """
        try:
            mark = _decode(sample.attachment)
        except (msgspec.MsgspecError, ValueError, OverflowError, RecursionError):
            return (sample,)
        stream = self._stream(sample.key, mark.source, mark.boot_id)
        number = mark.sequence
        if number < stream.next:
            return (sample,)
        if number == stream.next and not stream.held and number > stream.upto:
            stream.next = number + 1
            return (sample,)
        stream.upto = max(stream.upto, number)
        if number not in stream.held:
            stream.held[number] = sample
            self._held_bytes += len(sample.payload)
        return self._go_on(stream, sample.key, (mark.source, mark.boot_id), stream.run())

    def expect(self, sender: Sender, key: str, newest: int) -> None:
        """Take note that everything up to a number has been said."""
        stream = self._stream(key, *sender)
        if newest >= stream.next:
            stream.upto = max(stream.upto, newest)
            self._go_on(stream, key, sender, [])

    @property
    def waiting(self) -> bool:
        """Something is missing."""
        return bool(self._open)

    def open(self) -> list[Sender]:
        """Senders of which something is missing."""
        return list(self._open)

    def gaps(self, sender: Sender) -> dict[str, Span]:
        """What is missing of a sender, by key."""
        keys = self._open.get(sender, ())
        found = {key: self._streams[key, *sender].gap() for key in keys}
        return {key: gap for key, gap in found.items() if gap is not None}

    def give_up(self, sender: Sender, key: str, through: int) -> Sequence[Sample]:
        """Wait no more for numbers up to `through`; what may go on now."""
        stream = self._streams.get((key, *sender))
        if stream is None or through < stream.next:
            return ()
        found = [stream.held.pop(number) for number in sorted(stream.held) if number <= through]
        if stream.told:
            self.missed += through + 1 - stream.next - len(found)
        stream.told = True
        stream.next = through + 1
        return self._go_on(stream, key, sender, found + stream.run())

    def give_up_all(self, sender: Sender) -> list[Sample]:
        """Wait for nothing more of a sender; what may go on now."""
        waiting = [(key, self._streams[key, *sender].upto) for key in self._open.get(sender, ())]
        return [one for key, through in waiting for one in self.give_up(sender, key, through)]

    def _stream(self, key: str, source: str, boot_id: str) -> _Stream:
        name = (key, source, boot_id)
        stream = self._streams.get(name)
        if stream is None:
            if len(self._streams) >= MOST_STREAMS:
                self._forget()
            newest = self._newest(key, source, boot_id)
            stream = self._streams[name] = _Stream(newest + 1, self._told or newest >= 0)
        return stream

    def _go_on(self, stream: _Stream, key: str, sender: Sender, found: list[Sample]) -> list[Sample]:
        self._held_bytes -= sum(len(sample.payload) for sample in found)
        if self._held_bytes > HELD_BYTES:
            self._held_bytes -= sum(len(sample.payload) for sample in stream.held.values())
            stream.held.clear()
        if not stream.whole:
            self._open.setdefault(sender, set()).add(key)
        elif sender in self._open:
            self._open[sender].discard(key)
            if not self._open[sender]:
                del self._open[sender]
        return found

    def _forget(self) -> None:
        """Make room: the older half of what waits for nothing."""
        idle = [name for name, stream in self._streams.items() if stream.whole]
        for name in idle[: 1 + len(idle) // 2]:
            del self._streams[name]
