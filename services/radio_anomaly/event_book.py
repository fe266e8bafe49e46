"""Events from their first sight to their end: one identity for every word about the same stretch."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Literal

import msgspec

from schemas.radio import Cause, Kind
from services.radio_anomaly.passes import Journey

QUIET_PASSES: Final = 2
"""Passes over a stretch on which nothing is found any more, before its event has ended."""


class OpenEvent(msgspec.Struct, kw_only=True):
    """An event that has not ended."""

    event_id: str
    radio: str
    channel: str
    kind: Kind
    start: int
    length: int
    """Sections; 0 for the whole line."""
    first_seen_ns: int
    confirmed: bool
    quiet: int = 0
    passes: int = 0
    """On which it was found."""
    cause: Cause = "unknown"
    """As told last."""
    incident_id: str = ""
    """Of the events that are one thing with it: the identity of the first of them."""

    def covers(self, section: int) -> bool:
        """Whether a section lies in it."""
        return self.length == 0 or self.start <= section < self.start + self.length


class EventBook:
    """The open events."""

    def __init__(self, events: Iterable[OpenEvent] = ()) -> None:
        """As kept before."""
        self.open: list[OpenEvent] = list(events)
        self._seen: set[str] = set()

    def see(
        self, journey: Journey, radio: str, channel: str, kind: Kind, stretch: tuple[int, int], *, confirmed: bool
    ) -> tuple[OpenEvent, Literal["began", "goes_on"]]:
        """The event that a finding on this pass belongs to, as it is now."""
        start, length = stretch
        for one in self.open:
            if (one.radio, one.channel, one.kind) != (radio, channel, kind) or not _meet(one, start, length):
                continue
            one.quiet = 0
            one.confirmed = one.confirmed or confirmed
            if one.length and length:
                end = max(one.start + one.length, start + length)
                one.start = min(one.start, start)
                one.length = end - one.start
            self._seen.add(one.event_id)
            return one, "goes_on"
        new = OpenEvent(
            event_id=f"{kind}:{radio}:{channel}:{start}:{journey.first_ns // 1_000_000_000}",
            radio=radio,
            channel=channel,
            kind=kind,
            start=start,
            length=length,
            first_seen_ns=journey.first_ns,
            confirmed=confirmed,
        )
        self.open.append(new)
        self._seen.add(new.event_id)
        return new, "began"

    def close(self, journey: Journey) -> list[OpenEvent]:
        """Events that have ended with this pass: the train went there again, and nothing was found."""
        ended = []
        for one in self.open:
            if one.event_id in self._seen:
                one.passes += 1
                continue
            here = sum(one.covers(section) for section in journey.passed)
            if here >= max(1, (one.length or len(journey.passed)) // 2):
                one.quiet += 1
                if one.quiet >= QUIET_PASSES:
                    ended.append(one)
        gone = {one.event_id for one in ended}
        self.open = [one for one in self.open if one.event_id not in gone]
        self._seen.clear()
        return ended

    def held(self, radio: str, channel: str, section: int) -> bool:
        """Whether a confirmed event about a section is open."""
        return any(
            one.confirmed and (one.radio, one.channel) == (radio, channel) and one.covers(section) for one in self.open
        )


def _meet(one: OpenEvent, start: int, length: int) -> bool:
    if one.length == 0 or length == 0:
        return one.length == length
    # Neighbours are one: a fault seldom ends where a section does.
    return one.start <= start + length and start <= one.start + one.length
