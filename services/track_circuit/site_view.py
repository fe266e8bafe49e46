"""What the circuits of a site say, as lines and as a table for a terminal. Pure: times come in as arguments."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final

from rich.console import Group
from rich.table import Table
from rich.text import Text

from schemas.message import Message
from schemas.track_circuit import CircuitEvent, CircuitOccupancy, CodedCarrier, EqualiserState, Telegram

RECENT_S: Final = 5.0
"""Telegrams of this long are counted."""
KEPT_LEVELS: Final = 40
"""One per second."""
KEPT_EVENTS: Final = 14
STALE_S: Final = 3.0
"""A circuit that says nothing for longer is not believed."""
BLOCKS: Final = "▁▂▃▄▅▆▇█"
SPAN_DB: Final = 24.0
"""From the lowest to the highest block: what ballast moves a kilometre by."""


@dataclass
class CircuitView:
    """One circuit as last heard."""

    name: str
    heard_s: float = 0.0
    occupancy: CircuitOccupancy | None = None
    receiver: str = ""
    evm_db: float | None = None
    levels_db: deque[float | None] = field(default_factory=lambda: deque(maxlen=KEPT_LEVELS))
    telegrams: deque[tuple[float, str]] = field(default_factory=lambda: deque(maxlen=1000))
    level_due_s: float = 0.0

    def recent(self, now_s: float) -> tuple[int, int]:
        """Good telegrams and others of the last RECENT_S."""
        states = [state for t_s, state in self.telegrams if now_s - t_s <= RECENT_S]
        good = sum(state == "good" for state in states)
        return good, len(states) - good

    def state(self, now_s: float) -> str:
        """In words; what is not known is occupied."""
        if self.occupancy is None or now_s - self.heard_s > STALE_S:
            return "silent"
        restrictive = ", most restrictive" if self.occupancy.most_restrictive else ""
        return f"{self.occupancy.state}{restrictive}"


class SiteView:
    """All circuits heard, by name, and the latest events."""

    def __init__(self) -> None:
        """Nothing heard yet."""
        self.circuits: dict[str, CircuitView] = {}
        self.events: deque[tuple[float, CircuitEvent]] = deque(maxlen=KEPT_EVENTS)
        self._start_s: float | None = None

    def take(self, name: str, message: Message, now_s: float) -> str:
        """Take what a circuit said; an event comes back as a line of the log, anything else as nothing."""
        self._start_s = now_s if self._start_s is None else self._start_s
        view = self.circuits.setdefault(name, CircuitView(name))
        view.heard_s = now_s
        match message:
            case CircuitOccupancy():
                view.occupancy = message
                if now_s >= view.level_due_s:
                    view.levels_db.append(message.level_db)
                    view.level_due_s = now_s + 0.9
            case Telegram():
                view.telegrams.append((now_s, message.state))
                view.evm_db = message.evm_db
            case CodedCarrier():
                view.telegrams.append((now_s, message.state))
            case EqualiserState():
                view.receiver = message.receiver
            case CircuitEvent():
                self.events.append((now_s, message))
                return self.event_line(now_s, message)
            case _:
                pass
        return ""

    def event_line(self, t_s: float, event: CircuitEvent) -> str:
        """Seconds since the first word heard, circuit, kind, text."""
        return f"{t_s - (self._start_s or 0.0):7.1f} s  {event.circuit:10} {event.kind:15} {event.text}"


def spark(levels_db: deque[float | None]) -> str:
    """Levels as blocks, the highest of them the tallest; a dot where there was no signal.

    >>> spark(deque([-20.0, -32.0, None]))
    '█▅·'
    """
    known = [level for level in levels_db if level is not None]
    top = max(known, default=0.0)
    heights = (None if one is None else 1.0 - (top - one) / SPAN_DB for one in levels_db)
    last = len(BLOCKS) - 1
    return "".join("·" if one is None else BLOCKS[min(last, max(0, int(one * len(BLOCKS))))] for one in heights)


def _db(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f} dB"


def status_line(view: CircuitView, now_s: float) -> str:
    """A circuit in one line of plain text."""
    good, others = view.recent(now_s)
    level_db = None if view.occupancy is None else view.occupancy.level_db
    reference_db = None if view.occupancy is None else view.occupancy.reference_db
    return (
        f"{view.name:10} {view.state(now_s):27} level {_db(level_db)} (reference {_db(reference_db)}), "
        f"EVM {_db(view.evm_db)}, telegrams of {RECENT_S:g} s: {good} good, {others} not"
    )


def render(site: SiteView, line: str, now_s: float) -> Group:
    """A table of circuits, and the events below it."""
    table = Table(title=f"track circuits of line {line}", title_justify="left", expand=False)
    for heading in ("circuit", "state", "receiver", "level", "reference", "EVM", "good", "not good", "level over 40 s"):
        table.add_column(heading, no_wrap=True)
    for name in sorted(site.circuits):
        view = site.circuits[name]
        good, others = view.recent(now_s)
        state = view.state(now_s)
        color = "green" if state == "clear" else "red" if "restrictive" in state or state == "silent" else "yellow"
        occupancy = view.occupancy
        table.add_row(
            name,
            Text(state, style=color),
            view.receiver,
            _db(None if occupancy is None else occupancy.level_db),
            _db(None if occupancy is None else occupancy.reference_db),
            _db(view.evm_db),
            Text(str(good), style="green" if good else "dim"),
            Text(str(others), style="red" if others else "dim"),
            spark(view.levels_db),
        )
    waiting = Text("nothing heard yet", style="dim")
    log = Text("\n".join(site.event_line(t_s, event) for t_s, event in site.events))
    return Group(table if site.circuits else waiting, log)
