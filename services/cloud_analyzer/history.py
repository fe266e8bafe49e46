"""What a store of the cloud promises, whichever engine it stands on.

A store has one writer. `commit` returns when everything of it is on disk, or raises and has kept nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from schemas.bridge import BridgedRecord, StoreAnswer, StoreQuestion
from services.cloud_analyzer.result_tables import Findings
from services.cloud_analyzer.tables import Rows
from services.lte_bridge.deduplication import StateRow

DAY_NS = 86_400_000_000_000


class StoreError(RuntimeError):
    """The store will not or cannot; the text says why and what to do."""


class StoreTimeoutError(StoreError):
    """A question took longer than it may."""


SECTION_M = 100.0
"""Sections over which a store keeps sums."""


def days_of(question: StoreQuestion) -> tuple[int | None, int | None]:
    """First and last day, counted from 1970, that a question's time touches."""
    last = None if question.until_ns is None else (question.until_ns - 1) // DAY_NS
    return None if question.from_ns is None else question.from_ns // DAY_NS, last


@dataclass(frozen=True, slots=True)
class Commit:
    """One transaction of the ingest: rows, what was had, and what is still to be said again."""

    rows: Rows
    had: tuple[StateRow, ...] = ()
    forgotten: tuple[str, ...] = ()
    outbox: tuple[BridgedRecord, ...] = ()


class SectionSums(NamedTuple):
    """n, Σ and Σ² of the pass values [dBm] of a section: they merge by adding."""

    day: int | None
    """Counted from 1970; None where days are merged."""
    radio: str
    channel: str
    direction: str
    cell: str
    section: int
    """Its start is `section` times SECTION_M of kilometrage."""
    n: int
    total: float
    squares: float


@dataclass(frozen=True, slots=True)
class Learned:
    """What a store has learned."""

    sums: tuple[SectionSums, ...]
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
        """A page of rows of the line. Raises StoreError, StoreTimeoutError, and ValueError for a page that is none."""

    def keep(self, findings: Findings) -> None:
        """Make models, and what they found, durable. The same once more replaces itself. Raises StoreError."""

    def learn(
        self,
        first_day: int | None = None,
        last_day: int | None = None,
        *,
        by_day: bool = False,
        timeout_s: float = 600.0,
    ) -> Learned:
        """Sums over pass values by section; days counted from 1970, both included. Raises StoreError."""

    def tend(self, now_ns: int) -> str:
        """Move closed days to their files and forget what is older than it is kept; what was done, in words."""

    def close(self) -> None:
        """End it."""
