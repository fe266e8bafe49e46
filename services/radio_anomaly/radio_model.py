"""The model file: what was learned, from what, with what evidence, and what is remembered besides."""

from __future__ import annotations

from typing import Annotated, Final

import msgspec
from msgspec import Meta

from schemas.radio import BinSums, RadioAcceptance
from services.radio_anomaly.acceptance import Acceptances
from services.radio_anomaly.alarm_count import AlarmCount
from services.radio_anomaly.baseline import Book, Sums
from services.radio_anomaly.event_book import EventBook, OpenEvent
from services.radio_anomaly.heard_before import HeardBefore, HeardUntil, Telling
from services.radio_anomaly.held_out import HeldOut
from services.radio_anomaly.monitor import Monitor
from services.radio_anomaly.passes import Journey
from services.radio_anomaly.precursor import Point
from services.radio_anomaly.raising import Evidence
from services.radio_anomaly.reception_curve import ReceptionCurve
from services.radio_anomaly.settings import Method, Settings
from services.radio_anomaly.stream_state import TemperatureEffect
from services.radio_anomaly.window_test import Correlation

FORMAT: Final = 1
Window = tuple[str, str, str, int, int]


class Origin(msgspec.Struct, frozen=True, kw_only=True):
    """What a model was learned from."""

    source: str = ""
    """File, or service."""
    first_utc: str = ""
    last_utc: str = ""
    passes: int = 0
    readings: int = 0
    refused: dict[str, int] = msgspec.field(default_factory=dict)
    """By reason."""


class StreamPart(msgspec.Struct, frozen=True, kw_only=True):
    """A radio and channel beside its sums."""

    radio: str
    channel: str
    passes: float
    temperature: TemperatureEffect


class PendingPass(msgspec.Struct, frozen=True, kw_only=True):
    """A pass of a day that is not over, with the sections that are not to be learned."""

    journey: Journey
    withheld: tuple[tuple[str, str, tuple[int, ...]], ...] = ()


class RadioModel(msgspec.Struct, frozen=True, kw_only=True):
    """A model file (JSON)."""

    format: Annotated[int, Meta(ge=1)] = FORMAT
    method: Method = "line"
    settings: Settings = msgspec.field(default_factory=Settings)
    origin: Origin = msgspec.field(default_factory=Origin)
    evidence: HeldOut | None = None
    sums: tuple[BinSums, ...] = ()
    withheld: tuple[BinSums, ...] = ()
    """Judged abnormal: learned only where a person accepts it as the new normal."""
    streams: tuple[StreamPart, ...] = ()
    passed: tuple[tuple[str, int, float], ...] = ()
    heard: tuple[tuple[str, str, str, int, float, float], ...] = ()
    """Radio, channel, direction, section, passes that heard it, passes there before it was heard first."""
    silent: tuple[tuple[str, str, int], ...] = ()
    curve: ReceptionCurve = msgspec.field(default_factory=ReceptionCurve)
    alarms: AlarmCount = msgspec.field(default_factory=AlarmCount)
    """Of passes judged before they were learned."""
    windows: tuple[tuple[Window, tuple[tuple[float, float], ...]], ...] = ()
    trends: tuple[tuple[Window, tuple[Point, ...]], ...] = ()
    events: tuple[OpenEvent, ...] = ()
    acceptances: tuple[RadioAcceptance, ...] = ()
    pending: tuple[PendingPass, ...] = ()
    heard_until: tuple[HeardUntil, ...] = ()
    """What the bus may say again and is learned."""
    telling: tuple[Telling, ...] = ()
    """Of passes under way."""


def model_of(monitor: Monitor, origin: Origin, evidence: HeldOut | None) -> RadioModel:
    """All that a monitor knows."""
    streams = sorted(monitor.streams.items())
    return RadioModel(
        settings=monitor.settings,
        origin=origin,
        evidence=evidence,
        sums=tuple(row for key, state in streams for q, book in state.books.items() for row in _rows(key, q, book)),
        withheld=tuple(
            row
            for key, state in streams
            for q, book in state.books.items()
            for row in _rows(key, q, book, withheld=True)
        ),
        streams=tuple(
            StreamPart(radio=key[0], channel=key[1], passes=state.passes, temperature=state.temperature)
            for key, state in streams
        ),
        passed=tuple((*key, count) for key, count in sorted(monitor.presence.passed.items())),
        heard=tuple(
            (*key, count, monitor.presence.since[key]) for key, count in sorted(monitor.presence.heard.items())
        ),
        silent=tuple(sorted(monitor.presence.silent)),
        curve=monitor.curve,
        alarms=msgspec.structs.replace(monitor.alarms),
        windows=tuple(sorted(monitor.windows.kept.items())),
        trends=tuple(sorted(monitor.trend_memory.kept.items(), key=lambda item: item[0])),
        events=tuple(monitor.events.open),
        acceptances=tuple(monitor.acceptances.log),
        pending=tuple(
            PendingPass(
                journey=journey,
                withheld=tuple((*key, tuple(sorted(sections))) for key, sections in sorted(withheld.items())),
            )
            for journey, withheld in monitor.pending
        ),
        heard_until=monitor.heard.kept(),
    )


def monitor_of(model: RadioModel) -> Monitor:
    """A monitor that knows what the model holds."""
    monitor = Monitor(model.settings, model.evidence.correlation if model.evidence else Correlation())
    for rows, withheld in ((model.sums, False), (model.withheld, True)):
        for row in rows:
            group = (row.direction, row.section, row.cell)
            monitor.streams[(row.radio, row.channel)].books[row.quantity].add(
                row.day, group, Sums(row.n, row.sum, row.sum_squares), withheld=withheld
            )
    for part in model.streams:
        state = monitor.streams[(part.radio, part.channel)]
        state.passes, state.temperature = part.passes, part.temperature
    for direction, section, count in model.passed:
        monitor.presence.passed[(direction, section)] = count
    for radio, channel, direction, section, count, since in model.heard:
        monitor.presence.heard[(radio, channel, direction, section)] = count
        monitor.presence.since[(radio, channel, direction, section)] = since
    monitor.presence.silent = set(model.silent)
    monitor.curve = model.curve
    monitor.alarms = msgspec.structs.replace(model.alarms)
    monitor.windows.kept = dict(model.windows)
    monitor.trend_memory.kept = dict(model.trends)
    monitor.events = EventBook(model.events)
    monitor.acceptances = Acceptances(model.acceptances)
    monitor.heard = HeardBefore(model.heard_until)
    monitor.pending = [
        (one.journey, {(radio, channel): frozenset(sections) for radio, channel, sections in one.withheld})
        for one in model.pending
    ]
    return monitor


def evidence_of(model: RadioModel) -> Evidence:
    """What is shown with each event."""
    if model.evidence is None:
        return Evidence()
    return Evidence(false_alarm_rate=model.evidence.rate, cells=model.evidence.cells)


def _rows(key: tuple[str, str], quantity: str, book: Book, *, withheld: bool = False) -> list[BinSums]:
    table = book.withheld if withheld else book.learned
    return [
        BinSums(
            quantity=quantity,
            day=day,
            radio=key[0],
            channel=key[1],
            direction=direction,  # type: ignore[arg-type]  # up, down or empty, as it came
            section=section,
            cell=cell,
            n=sums.n,
            sum=sums.total,
            sum_squares=sums.squares,
        )
        for (direction, section, cell), days in sorted(table.items())
        for day, sums in sorted(days.items())
    ]
