"""What a sender still keeps of its KEPT publications, for whoever has missed some."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, field

from schemas.message import Message, Part

Span = tuple[int, int]
"""First and last sequence number, both included; empty when the last is smaller."""


class RetainedRecord(Part, frozen=True, kw_only=True, array_like=True):
    """A publication as it was said."""

    key: str
    payload: bytes
    attachment: bytes


class RetainedQuestion(Message, frozen=True, kw_only=True):
    """Says what is wanted of one start of a sender; a question that wants nothing asks what there is."""

    boot_id: str = ""
    """The start whose publications are wanted."""
    wanted: dict[str, Span] = field(default_factory=dict)
    """By key."""
    most_bytes: Annotated[int, Meta(ge=1, le=512 * 1024)] = 512 * 1024
    """Of the records of one answer; one record at least is given."""


class RetainedAnswer(Message, frozen=True, kw_only=True):
    """Records in the order of their numbers, and what there is."""

    boot_id: str
    """The start that answers: nothing is known here of another one."""
    kept: dict[str, Span]
    """Of the keys wanted, or of all: what is kept, up to the newest that was said at least a second ago."""
    records: tuple[RetainedRecord, ...] = ()
    more: bool = False
    """There was no room for all that is wanted: ask again for the rest."""
