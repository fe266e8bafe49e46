"""Measurements as they come, gathered into passes that are under way and passes that are over."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import msgspec

from services.radio_anomaly.heard_before import Telling, Told
from services.radio_anomaly.passes import period_of, section_of
from services.radio_anomaly.reading import Reading
from services.radio_anomaly.settings import Settings

MOST_READINGS: Final = 200_000
"""Of one pass; a longer one is cut in two."""
MOST_SOURCES: Final = 2_000


class LivePass(msgspec.Struct, kw_only=True):
    """A pass under way, or a period at a site."""

    source: str
    device: str
    name: str
    direction: str
    readings: list[Reading] = msgspec.field(default_factory=list)
    heard: dict[str, tuple[int, int]] = msgspec.field(default_factory=dict)
    """Greatest number and latest time of its readings, by their sender's start."""
    heard_s: float = 0.0
    """Monotonic time of the last reading."""
    section: int | None = None
    sections_since: int = 0
    """Sections finished since the pass was judged last."""
    offset_m: float | None = None
    """Axis less kilometrage where it was last."""
    left_out: int = 0
    """Readings that a clock or a place that jumps, or repeating, spoiled."""
    told: Told = msgspec.field(default_factory=dict)
    shown: set[tuple[str, str, int]] = msgspec.field(default_factory=set)
    """Sections shown."""

    def note(self, boot_id: str, number: int, t_ns: int) -> None:
        """Keep which publications it is made of; those without a number (-1) cannot be known again."""
        if number >= 0:
            before = self.heard.get(boot_id, (number, t_ns))
            self.heard[boot_id] = (max(number, before[0]), max(t_ns, before[1]))


class LivePasses:
    """Passes under way, by who measures."""

    def __init__(self, settings: Settings, telling: Iterable[Telling] = ()) -> None:
        """None, or those that were under way when the watch was ended: they are heard again, but told already."""
        self._settings = settings
        self._telling = {one.source: one for one in telling}
        self.under_way: dict[str, LivePass] = {}

    def take(
        self, source: str, device: str, reading: Reading, axis_m: float | None, now_s: float
    ) -> tuple[LivePass, list[LivePass]]:
        """The pass that a reading belongs to, and passes that are over with it.

        `source` names place and device, and whether it measures along the line or at a site.
        """
        direction = reading.direction or ""
        name = reading.pass_id
        if not name and not direction:
            name = period_of(reading.t_ns, self._settings.period_s)
        over = []
        before = self.under_way.get(source)
        if before is not None and (
            (before.name, before.direction) != (name, direction) or len(before.readings) >= MOST_READINGS
        ):
            over.append(self.under_way.pop(source))
        if source not in self.under_way:
            if len(self.under_way) >= MOST_SOURCES:
                quietest = min(self.under_way, key=lambda key: self.under_way[key].heard_s)
                over.append(self.under_way.pop(quietest))
            told = self._told(source, name, direction)
            self.under_way[source] = LivePass(source=source, device=device, name=name, direction=direction, told=told)
        found = self.under_way[source]
        found.readings.append(reading)
        found.heard_s = now_s
        if axis_m is not None and reading.chainage_m is not None:
            found.offset_m = axis_m - reading.chainage_m
        if reading.chainage_m is not None:
            here = section_of(reading.chainage_m, self._settings.section_m)
            if found.section is not None and here != found.section:
                found.sections_since += 1
            found.section = here
        return found, over

    def _told(self, source: str, name: str, direction: str) -> Told:
        """What was told on a pass before the watch was ended in the middle of it."""
        before = self._telling.pop(source, None)
        return dict(before.told) if before is not None and (before.name, before.direction) == (name, direction) else {}

    def telling(self) -> tuple[Telling, ...]:
        """What is told so far on passes under way."""
        current = {
            one.source: Telling(source=one.source, name=one.name, direction=one.direction, told=dict(one.told))
            for one in self.under_way.values()
            if one.told
        }
        return tuple((self._telling | current).values())[-MOST_SOURCES:]

    def silent(self, now_s: float, after_s: float) -> list[LivePass]:
        """Passes of which nothing was heard for so long that they are over."""
        gone = [source for source, one in self.under_way.items() if now_s - one.heard_s >= after_s]
        return [self.under_way.pop(source) for source in gone]

    def rest(self) -> list[LivePass]:
        """Every pass, ended now."""
        found = list(self.under_way.values())
        self.under_way.clear()
        return found
