"""Passes out of the store's history, read page by page and binned as `kirotei radio` bins those of a file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import msgspec

from schemas.bridge import StoreAnswer, StoreQuestion
from services.cloud_analyzer.history import Store, StoreError
from services.cloud_analyzer.tables import Value
from services.radio_anomaly.passes import QUANTITIES, Journey, binned, pass_of, sorted_passes
from services.radio_anomaly.reading import Reading, refusal_of
from services.radio_anomaly.settings import Settings

PAGE_ROWS: Final = 50_000
PAGE_TIMEOUT_S: Final = 120.0
LONGEST_NS: Final = 6 * 3600 * 1_000_000_000
"""A pass takes no longer: so far beyond both ends of a time its passes are looked for."""
SILENT_NS: Final = 3600 * 1_000_000_000
"""A pass is over after this long without a measurement."""
NOT_BELIEVED: Final = "a clock that was not believed"
NO_PLACE: Final = "measured on board, and no place is known"
_STORED: Final = {"power_dbm": "channel_power_dbm"}
"""Columns of the store that have another name than the reading's field."""


@dataclass(slots=True)
class Passes:
    """Passes that began in a time, in order, and what could not be used of it."""

    journeys: list[Journey] = field(default_factory=list)
    readings: int = 0
    left_out: Counter[str] = field(default_factory=Counter)
    partial: str = ""


def never() -> bool:
    """Work that nobody stops."""
    return False


def pages(store: Store, question: StoreQuestion, stopped: Callable[[], bool] = never) -> Iterator[StoreAnswer]:
    """Every page of an answer. Raises StoreError, also once `stopped` says so."""
    asked = msgspec.structs.replace(question, limit=PAGE_ROWS)
    while not stopped():
        answer = store.ask(asked, PAGE_TIMEOUT_S)
        yield answer
        if not answer.next_page:
            return
        asked = msgspec.structs.replace(asked, page=answer.next_page)
    msg = "the service is stopping"
    raise StoreError(msg)


def passes_between(
    store: Store, from_ns: int, until_ns: int, settings: Settings, stopped: Callable[[], bool] = never
) -> Passes:
    """Passes that began at or after `from_ns` and before `until_ns`. Raises StoreError.

    Consecutive times give every pass once. No more is held in memory than one page of measurements, those of passes
    that are not over, and the passes binned so far.
    """
    gathering = _Gathering(from_ns, until_ns, settings)
    question = StoreQuestion(
        t_ns=0, about="radio", from_ns=max(from_ns - LONGEST_NS, 0), until_ns=until_ns + LONGEST_NS
    )
    found = gathering.found
    for answer in pages(store, question, stopped):
        found.partial = found.partial or answer.partial
        for reading in _readings(answer, found.left_out, (from_ns, until_ns)):
            gathering.take(reading)
        if answer.rows and gathering.is_over(int(answer.rows[-1][answer.columns.index("taken_ns")] or 0)):
            break
    gathering.finish(list(gathering.under_way))
    found.journeys.sort(key=lambda one: (one.first_ns, one.pass_id, one.direction))
    return found


@dataclass(slots=True)
class _Gathering:
    """Passes that are under way while measurements come in the order of their times."""

    from_ns: int
    until_ns: int
    settings: Settings
    found: Passes = field(default_factory=Passes)
    under_way: dict[tuple[str, str], list[Reading]] = field(default_factory=dict)

    def take(self, reading: Reading) -> None:
        """Add to its pass; after a long silence another one of that name has begun."""
        name = pass_of(reading, self.settings)
        begun = self.under_way.get(name)
        if begun is not None and reading.t_ns - begun[-1].t_ns > SILENT_NS:
            self.finish([name])
            begun = None
        if begun is None:
            self.under_way[name] = [reading]
        else:
            begun.append(reading)

    def is_over(self, now_ns: int) -> bool:
        """Finish what has been silent for long; whether no pass that is looked for can go on."""
        self.finish([name for name, begun in self.under_way.items() if now_ns - begun[-1].t_ns > SILENT_NS])
        return now_ns >= self.until_ns and all(begun[0].t_ns >= self.until_ns for begun in self.under_way.values())

    def finish(self, names: Sequence[tuple[str, str]]) -> None:
        """Bin passes that are over, and keep those that began in the time."""
        for name in names:
            groups, left = sorted_passes(self.under_way.pop(name), self.settings)
            for group in groups:
                if self.from_ns <= group[0].t_ns < self.until_ns:
                    self.found.journeys.append(binned(group, self.settings))
                    self.found.readings += len(group)
                    self.found.left_out += left


def _readings(answer: StoreAnswer, refused: Counter[str], counted: tuple[int, int]) -> Iterator[Reading]:
    """Measurements of a page that can be used, by the time that the store goes by; `counted`: when refusals count."""
    at = {name: answer.columns.index(name) for name in ("taken_ns", "clock", "pass_id", "radio", "channel")}
    place, direction = answer.columns.index("chainage_m"), answer.columns.index("direction")
    cell, side = answer.columns.index("cell"), answer.columns.index("side")
    figures = {name: answer.columns.index(_STORED.get(name, name)) for name in QUANTITIES.values()}
    for row in answer.rows:
        t_ns = int(row[at["taken_ns"]] or 0)
        here = int(counted[0] <= t_ns < counted[1])
        if row[at["clock"]]:
            refused[NOT_BELIEVED] += here
            continue
        placed = row[place] is not None and row[direction] in ("up", "down")
        if row[side] == "onboard" and not placed:
            refused[NO_PLACE] += here
            continue
        reading = Reading(
            t_ns=t_ns,
            pass_id=_text(row[at["pass_id"]]),
            radio=_text(row[at["radio"]]),
            channel=_text(row[at["channel"]]),
            direction=row[direction] if placed else None,  # type: ignore[arg-type]  # one of the two
            chainage_m=row[place] if placed else None,  # type: ignore[arg-type]  # a number
            cell=_text(row[cell]),
            **{name: row[index] for name, index in figures.items()},  # type: ignore[arg-type]  # numbers or None
        )
        reason = refusal_of(reading)
        if reason is None:
            yield reading
        else:
            refused[_general(reason)] += here


def _text(value: Value) -> str:
    return "" if value is None else str(value)


def _general(reason: str) -> str:
    """A reason without its figures, for counting."""
    name = reason.split(" ", 1)[0]
    return f"{name} out of its range" if name == "chainage_m" or name in QUANTITIES.values() else reason
