"""Events that are one thing: an interferer that eight radios hear on both ways is one line for a person at night.

Two open events belong together when they are of one radio and meet; when they have the same known cause, lie within
NEAR_M of each other and, on different radios, began within JOIN_NS; when one radio's device fails; and when snow lies
on several. Unconfirmed events join an incident, but hold none together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from schemas.radio import Cause
from services.radio_anomaly.event_book import OpenEvent

NEAR_M: Final = 1000.0
JOIN_NS: Final = 3 * 86_400_000_000_000
"""What begins on another radio later than this is news, though it be near."""
NAMED: Final = 8
"""Radios and channels that are named; the rest are counted."""


def put_together(fresh: Sequence[OpenEvent], known: Sequence[OpenEvent], section_m: float) -> None:
    """Give each of the events seen on this pass the incident that it belongs to; `known` are all that are open."""
    for event in fresh:
        if not event.incident_id:
            event.incident_id = event.event_id
        others = [
            one
            for one in known
            if one is not event and one.confirmed and one.incident_id and _one(event, one, section_m)
        ]
        names = {event.incident_id, *(one.incident_id for one in others)}
        began = {name: _begin(name, known) for name in sorted(names)}
        oldest = min(began, key=lambda name: began[name])
        if event.confirmed:
            for one in known:
                if one.incident_id in names:
                    one.incident_id = oldest
        else:
            event.incident_id = oldest


def words_of(incident_id: str, known: Sequence[OpenEvent], section_m: float) -> str:
    """An incident so far, in words: of its confirmed events, or of what there is."""
    mine = [one for one in known if one.incident_id == incident_id]
    mine = [one for one in mine if one.confirmed] or mine
    if not mine:
        return ""
    stretches: dict[tuple[str, str], tuple[int, int] | None] = {}
    for one in mine:
        key = (one.radio, one.channel)
        before = stretches.get(key, (one.start, one.start))
        whole = not one.length or before is None
        stretches[key] = None if whole else (min(before[0], one.start), max(before[1], one.start + one.length))  # type: ignore[index]  # `whole` holds where it is None
    told = sorted(stretches.items(), key=lambda item: item[0])
    listed = [f"{radio} {channel} {_kilometres(stretch, section_m)}" for (radio, channel), stretch in told[:NAMED]]
    more = f" and {len(told) - NAMED} more" if len(told) > NAMED else ""
    radios = len({radio for radio, _ in stretches})
    count = "" if radios == 1 else f"{radios} radios, "
    return f"{_cause(mine)}, {count}{len(mine)} event{'s' * (len(mine) > 1)}: {', '.join(listed)}{more}"


def _cause(events: Sequence[OpenEvent]) -> Cause:
    """The cause that most of them have, unknown only where all of them are."""
    causes: list[Cause] = [one.cause for one in events if one.cause != "unknown"]
    return max(sorted(set(causes)), key=causes.count) if causes else "unknown"


def _kilometres(stretch: tuple[int, int] | None, section_m: float) -> str:
    if stretch is None:
        return "whole line"
    return f"{stretch[0] * section_m / 1000.0:.1f}-{stretch[1] * section_m / 1000.0:.1f} km"


def _begin(incident_id: str, known: Sequence[OpenEvent]) -> tuple[int, int]:
    """When an incident began, and its first event's place among those known, for those of one time."""
    mine = [(one.first_seen_ns, number) for number, one in enumerate(known) if one.incident_id == incident_id]
    return min(mine)


def _one(event: OpenEvent, other: OpenEvent, section_m: float) -> bool:
    """Whether two events are one thing."""
    same_radio = event.radio == other.radio
    apart_m = _apart(event, other) * section_m
    if same_radio and (apart_m <= 0.0 or not (event.length and other.length)):
        return True
    if event.cause != other.cause or event.cause == "unknown":
        return False
    if same_radio:
        return event.cause == "device" or apart_m <= NEAR_M
    if abs(event.first_seen_ns - other.first_seen_ns) > JOIN_NS:
        return False
    return event.cause == "snow" or apart_m <= NEAR_M


def _apart(one: OpenEvent, other: OpenEvent) -> float:
    """Sections between two stretches, 0 where they meet; without bound for a whole line, which has none."""
    if not (one.length and other.length):
        return float("inf")
    return float(max(one.start - (other.start + other.length), other.start - (one.start + one.length), 0))
