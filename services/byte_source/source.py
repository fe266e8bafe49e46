"""What every live source of bytes can do, whatever it stands on."""

from __future__ import annotations

from typing import Final, Protocol

READ_S: Final = 0.25
"""Longest time that one reading waits; a service asked to stop does so within it."""
WRITE_S: Final = 2.0
"""Longest time that sending waits."""
OPEN_S: Final = 10.0
"""Longest time that opening waits for an answer."""
CHUNK: Final = 4096


class SourceError(Exception):
    """A source that cannot be opened or has gone away; says in words what is wrong and what to do."""


class ByteSource(Protocol):
    """A connection that blocks: call it in a thread from asyncio code."""

    @property
    def name(self) -> str:
        """Where the bytes come from, as it stands in messages; holds no secret."""

    def open(self) -> None:
        """Connect. Raises SourceError."""

    def read(self) -> bytes:
        """Bytes that have come, none when nothing came within READ_S. Raises SourceError when it is gone."""

    def close(self) -> None:
        """Disconnect; closing twice is no fault."""


class RetryPauses:
    """Pauses between attempts: one second, doubling up to half a minute."""

    SHORTEST_S: Final = 1.0
    LONGEST_S: Final = 30.0

    def __init__(self) -> None:
        """Begin with the shortest."""
        self._next_s = self.SHORTEST_S

    def take(self) -> float:
        """Next pause [s]."""
        pause_s = self._next_s
        self._next_s = min(2.0 * pause_s, self.LONGEST_S)
        return pause_s

    def reset(self) -> None:
        """Begin anew: the source works."""
        self._next_s = self.SHORTEST_S
