"""What is in the model already, by its senders' numbers: the bus says again what was heard before a restart.

Numbers, not times: a sender counts up on each key from its start, whatever its clock does meanwhile. Kept in the model
itself, so that what was learned and the word that it was learned reach the disk as one.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final, Literal

import msgspec

from schemas.radio import Cause

MOST_SENDERS: Final = 8_000
"""Starts of senders by source; of more, those that were learned from longest ago are forgotten."""
Told = dict[str, tuple[bool, Cause]]
"""Events told on a pass, whether as confirmed, and with which cause."""


class HeardUntil(msgspec.Struct, frozen=True, kw_only=True):
    """How far one start of a sender was learned from, on one source."""

    source: str
    """Place and device, and whether along the line or at a site."""
    boot_id: str
    number: int
    """Greatest sequence number of a pass that is over."""
    newest_ns: int
    """Latest time stamp of such a pass."""


class Telling(msgspec.Struct, frozen=True, kw_only=True):
    """Events told on a pass that is under way."""

    source: str
    name: str
    direction: str
    told: Told


class HeardBefore:
    """How far every sender was learned from."""

    def __init__(self, kept: Iterable[HeardUntil] = ()) -> None:
        """As kept before, those that were learned from longest ago first."""
        self._until = {(one.source, one.boot_id): (one.number, one.newest_ns) for one in kept}

    def is_again(self, source: str, boot_id: str, number: int, t_ns: int) -> Literal["new", "again", "renumbered"]:
        """Whether a reading is of a pass that is over and learned.

        `renumbered` is new as well: its number was had, yet it is later than all that was learned under such numbers,
        so that its sender counts anew without saying so. What bears no number (-1) is never said again by the bus.
        """
        if number < 0 or (source, boot_id) not in self._until:
            return "new"
        last, newest_ns = self._until[source, boot_id]
        if number > last:
            return "new"
        return "renumbered" if t_ns > newest_ns else "again"

    def learned(self, source: str, heard: Mapping[str, tuple[int, int]]) -> None:
        """Note a pass that is over: greatest number and latest time of its readings by their sender's start."""
        for boot_id, (number, newest_ns) in heard.items():
            before = self._until.pop((source, boot_id), (number, newest_ns))
            self._until[source, boot_id] = (max(number, before[0]), max(newest_ns, before[1]))
        while len(self._until) > MOST_SENDERS:
            del self._until[next(iter(self._until))]

    def kept(self) -> tuple[HeardUntil, ...]:
        """For the model."""
        return tuple(
            HeardUntil(source=source, boot_id=boot_id, number=number, newest_ns=newest_ns)
            for (source, boot_id), (number, newest_ns) in self._until.items()
        )
