"""What is in a recording: keys, counts, rates, senders, gaps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from schemas.topics import topic_of
from services.recorder.recording_file import Fault, Scanner
from services.runtime.attachment import decode_attachment
from services.runtime.node import Sample
from services.runtime.sequence import SequenceTracker

TOLD_EVERY = 4096
"""Messages between two calls of `progress`."""


@dataclass(slots=True)
class KeyContents:
    """What was recorded on one key."""

    key: str
    topic: str
    """Short name of the topic; empty for a key that no topic has."""
    messages: int = 0
    octets: int = 0
    first_ns: int = 0
    last_ns: int = 0
    longest_silence_s: float = 0.0
    senders: dict[str, SequenceTracker] = field(default_factory=dict)
    """By source; messages without a mark of ours have none."""

    def take(self, sample: Sample) -> None:
        """Note one message."""
        now_ns = sample.received_ns
        if self.messages:
            self.longest_silence_s = max(self.longest_silence_s, (now_ns - self.last_ns) / 1e9)
        else:
            self.first_ns = now_ns
        self.messages += 1
        self.octets += len(sample.payload)
        self.last_ns = now_ns
        mark = decode_attachment(sample.attachment) if sample.attachment else None
        if mark is not None:
            self.senders.setdefault(mark.source, SequenceTracker()).take(mark.boot_id, mark.sequence)

    @property
    def rate_hz(self) -> float | None:
        """Mean rate between the first and the last message; None for fewer than two times."""
        span_ns = self.last_ns - self.first_ns
        return (self.messages - 1) * 1e9 / span_ns if span_ns > 0 else None

    @property
    def missing(self) -> int:
        """Sequence numbers that were never received."""
        return sum(tracker.missing for tracker in self.senders.values())

    @property
    def restarts(self) -> int:
        """Times that a sender came back with another boot id."""
        return sum(tracker.restarts for tracker in self.senders.values())


@dataclass(slots=True)
class Contents:
    """What is in one file."""

    path: Path
    file_bytes: int
    complete: bool
    faults: list[Fault]
    keys: dict[str, KeyContents]
    lost_messages: int

    @property
    def messages(self) -> int:
        """Of all keys."""
        return sum(entry.messages for entry in self.keys.values())

    @property
    def first_ns(self) -> int | None:
        """Earliest first message of a key; None when there is none."""
        return min((entry.first_ns for entry in self.keys.values()), default=None)

    @property
    def last_ns(self) -> int | None:
        """Latest last message of a key."""
        return max((entry.last_ns for entry in self.keys.values()), default=None)


def contents_of(path: Path, progress: Callable[[int], None] | None = None) -> Contents:
    """Contents of a recording, whole or broken; `progress` hears the number of bytes read.

    Raises OSError. A file that is no recording has one fault and no keys.
    """
    faults: list[Fault] = []
    keys: dict[str, KeyContents] = {}
    with path.open("rb") as stream:
        scanner = Scanner(stream, faults.append)
        for sample in scanner.samples():
            entry = keys.get(sample.key)
            if entry is None:
                address = topic_of(sample.key)
                entry = keys[sample.key] = KeyContents(sample.key, "" if address is None else address.topic.name)
            entry.take(sample)
            if progress is not None and scanner.messages % TOLD_EVERY == 0:
                progress(scanner.whole_bytes)
        return Contents(path, scanner.size, scanner.finished, faults, keys, scanner.lost_messages)
