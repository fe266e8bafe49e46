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
LONGEST_NS: Final = 12 * 3600 * 1_000_000_000
"""A pass takes no longer: so far beyond both ends of a time its passes are looked for."""
SILENT_NS: Final = 3600 * 1_000_000_000
"""A pass is over after this long without a measurement."""
NOT_BELIEVED: Final = "a clock that was not believed"
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
    found = Passes()
    under_way: dict[tuple[str, str], list[Reading]] = {}

    def finish(names: Sequence[tuple[str, str]]) -> None:
        for name in names:
            groups, left = sorted_passes(under_way.pop(name), settings)
            for group in groups:
                if from_ns <= group[0].t_ns < until_ns:
                    found.journeys.append(binned(group, settings))
                    found.readings += len(group)
                    found.left_out += left

    question = StoreQuestion(
        t_ns=0, about="radio", from_ns=max(from_ns - LONGEST_NS, 0), until_ns=until_ns + LONGEST_NS
    )
    for answer in pages(store, question, stopped):
        found.partial = found.partial or answer.partial
        for reading in _readings(answer, found.left_out, (from_ns, until_ns)):
            name = pass_of(reading, settings)
            begun = under_way.get(name)
            if begun is not None and reading.t_ns - begun[-1].t_ns > SILENT_NS:
                finish([name])
                begun = None
            if begun is None:
                under_way[name] = [reading]
            else:
                begun.append(reading)
        if answer.rows:
            now_ns = int(answer.rows[-1][answer.columns.index("taken_ns")] or 0)
            finish([name for name, begun in under_way.items() if now_ns - begun[-1].t_ns > SILENT_NS])
    finish(list(under_way))
    found.journeys.sort(key=lambda one: (one.first_ns, one.pass_id, one.direction))
    return found


def _readings(answer: StoreAnswer, refused: Counter[str], counted: tuple[int, int]) -> Iterator[Reading]:
    """Measurements of a page that can be used, by the time that the store goes by; `counted`: when refusals count."""
    at = {name: answer.columns.index(name) for name in ("taken_ns", "clock", "pass_id", "radio", "channel")}
    place, direction = answer.columns.index("chainage_m"), answer.columns.index("direction")
    cell = answer.columns.index("cell")
    figures = {name: answer.columns.index(_STORED.get(name, name)) for name in QUANTITIES.values()}
    for row in answer.rows:
        t_ns = int(row[at["taken_ns"]] or 0)
        here = int(counted[0] <= t_ns < counted[1])
        if row[at["clock"]]:
            refused[NOT_BELIEVED] += here
            continue
        placed = row[place] is not None and row[direction] in ("up", "down")
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
