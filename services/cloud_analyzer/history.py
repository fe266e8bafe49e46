"""What a store of the cloud promises, whichever engine it stands on.

A store has one writer. `commit` returns when everything of it is on disk, or raises and has kept nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from schemas.bridge import BridgedRecord, StoreAnswer, StoreQuestion
from schemas.radio import BinSums
from services.cloud_analyzer.tables import Rows
from services.lte_bridge.deduplication import StateRow


class StoreError(RuntimeError):
    """The store will not or cannot; the text says why and what to do."""


class StoreTimeoutError(StoreError):
    """A question took longer than it may."""


@dataclass(frozen=True, slots=True)
class Commit:
    """One transaction of the ingest: rows, what was had, and what is still to be said again."""

    rows: Rows
    had: tuple[StateRow, ...] = ()
    forgotten: tuple[str, ...] = ()
    outbox: tuple[BridgedRecord, ...] = ()


@dataclass(frozen=True, slots=True)
class Learned:
    """Sums over the samples of a day, or of several, in one section."""

    sums: tuple[BinSums, ...]
    partial: str = ""
    """What is missing and why."""


class Store(Protocol):
    """History of a line, or of several."""

    def commit(self, commit: Commit) -> int:
        """Number of the outbox entry, once everything is durable. Raises StoreError and keeps nothing."""

    def published(self, number: int) -> None:
        """Forget outbox entries up to a number: they have been said again."""

    def unpublished(self) -> Iterable[tuple[int, Sequence[BridgedRecord]]]:
        """Outbox entries that were committed and not said again, oldest first."""

    def had(self) -> Iterable[StateRow]:
        """What was had by the time of the last commit."""

    def ask(self, question: StoreQuestion, timeout_s: float) -> StoreAnswer:
        """A page of rows. Raises StoreError, StoreTimeoutError, and ValueError for a page that is none."""

    def learn(self, section_m: float, from_ns: int | None = None, until_ns: int | None = None) -> Learned:
        """Sums of channel power by day, radio, channel, direction and section. Raises StoreError."""

    def tend(self, now_ns: int) -> str:
        """Move closed days to their files and forget what is older than it is kept; what was done, in words."""

    def close(self) -> None:
        """End it."""
