"""The place of a train in a terminal: figures, a ruler of its bounds, and what happened. Pure rendering."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from schemas.position import TrainPosition
from services.runtime.sparkline import Sparkline
from services.runtime.watch_trains import TrainView, bounds_along_axis
from services.runtime.watch_words import Language, word

SHAPES: Final = {
    "valid": ("●", "green"),
    "degraded": ("▲", "yellow"),
    "lost": ("■", "red"),
    "stale": ("◇", "magenta"),
}
CHART_S: Final = 60.0
RULERS_M: Final = (5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0)
"""Half a ruler's length: the shortest that holds both bounds."""
COLUMNS: Final[tuple[tuple[int, tuple[str, ...]], ...]] = (
    (124, ("status", "age", "chainage", "speed", "bounds", "reference", "error", "outside", "minute")),
    (92, ("status", "age", "chainage", "speed", "bounds", "reference", "error", "outside")),
    (56, ("status", "age", "chainage", "speed", "bounds", "error")),
    (0, ("status", "chainage", "bounds")),
)
"""Least width and what is shown from there on; how the position stands, and its bounds, never go."""
LEAST_TOP_M: Final = 2.0


def train_panel(view: TrainView, now_s: float, language: Language) -> RenderableType:
    """Everything about one train's place."""
    rows: list[RenderableType] = [_FigureTable(view, now_s, language)]
    if not view.stale(now_s) and view.position is not None:
        if view.position.reason:
            rows.append(Text(view.position.reason, style="yellow"))
        if view.position.axis_m is not None:
            rows.append(Ruler(view, language))
    rows.extend(_events(view, now_s))
    return Panel(Group(*rows), title=Text(word("place_of", language, train=view.train)), title_align="left")


def status_of(view: TrainView, now_s: float) -> str:
    """'valid', 'degraded' or 'lost' as the newest position says, 'stale' when it is old."""
    return "stale" if view.position is None or view.stale(now_s) else view.position.status


@dataclass(frozen=True, slots=True)
class _FigureTable:
    """The figures of one train; where the terminal is narrow the less important ones go."""

    view: TrainView
    now_s: float
    language: Language

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """The table, for the width at hand."""
        del console
        names = next(columns for least, columns in COLUMNS if options.max_width >= least)
        cells = self._cells()
        top_m = _top_m(self.view, self.now_s)
        table = Table(box=None, expand=True, pad_edge=False)
        for name in names:
            table.add_column(
                word(name, self.language, top=top_m),
                justify="left" if name in ("status", "reference", "minute") else "right",
                no_wrap=True,
                ratio=1 if name == "minute" else None,
                min_width=12 if name == "minute" else None,
            )
        table.add_row(*(cells[name] for name in names))
        yield table

    def _cells(self) -> dict[str, RenderableType]:
        view, now_s = self.view, self.now_s
        status = status_of(view, now_s)
        shape, colour = SHAPES[status]
        position = view.position if status != "stale" else None
        told = f"{shape} {word(status if status != 'lost' else 'no_position', self.language)}"
        bounds = "-" if position is None else _bounds(position.bound_behind_m, position.bound_ahead_m)
        return {
            "status": Text(told, style=colour),
            "age": Text(f"{view.age_s(now_s):.1f} s" if math.isfinite(view.heard_s) else "-"),
            "chainage": Text(_place(position), style="bold"),
            "speed": Text(_speed(position)),
            "bounds": Text(bounds),
            "reference": Text(_reference(position)),
            "error": Text("-" if position is None or view.error_m is None else f"{-view.error_m:+.1f} m"),
            "outside": Text(str(view.outside) if view.errors else "-", style="bold red" if view.outside else ""),
            "minute": Sparkline(list(view.errors), now_s - CHART_S, now_s, _top_m(view, now_s), "cyan"),
        }


def _top_m(view: TrainView, now_s: float) -> float:
    return max([LEAST_TOP_M, *(error for at_s, error in view.errors if at_s >= now_s - CHART_S)])


def _place(position: TrainPosition | None) -> str:
    """Kilometrage as railways write it, with the direction of the front end and the branch."""
    if position is None or position.chainage_m is None:
        return "-"
    arrow = {"up": " ▶", "down": " ◀", None: ""}[position.direction]
    branch = "" if not position.branch else f" {position.branch}"
    slip = {-1: " slide", 1: " spin", 0: ""}[position.slip]
    return f"{kilometres(position.chainage_m)}{arrow}{branch}{slip}"


def kilometres(chainage_m: float) -> str:
    """Chainage with the kilometre apart.

    >>> kilometres(12345.6), kilometres(-20.0)
    ('12k345.6', '-0k020.0')
    """
    sign, size = ("-" if chainage_m < 0.0 else ""), round(abs(chainage_m), 1)
    return f"{sign}{int(size // 1000)}k{size % 1000:05.1f}"


def _speed(position: TrainPosition | None) -> str:
    return "-" if position is None or position.speed_mps is None else f"{position.speed_mps * 3.6:.0f} km/h"


def _bounds(behind_m: float | None, ahead_m: float | None) -> str:
    if behind_m is None or ahead_m is None:
        return "-"
    return f"-{behind_m:.1f} +{ahead_m:.1f} m"


def _reference(position: TrainPosition | None) -> str:
    if position is None or not position.reference:
        return "-"
    gone = position.reference_distance_m
    return position.reference if gone is None else f"{position.reference}, {gone:.0f} m ago"


@dataclass(frozen=True, slots=True)
class Ruler:
    """The stretch in which the front end is certain to be, with the estimate and, in a simulation, the truth."""

    view: TrainView
    language: Language

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """One line, as wide as there is room."""
        del console
        yield Text(ruler_line(self.view, max(options.max_width - 2, 20)), no_wrap=True, overflow="crop")


def ruler_line(view: TrainView, width: int) -> str:
    """Ruler towards rising `axis_m`: `[` and `]` bound the front end, `●` is the estimate, `×` the truth."""
    position = view.position
    if position is None:
        return ""
    rising, falling = bounds_along_axis(position)
    widest = max(one for one in (rising, falling, abs(view.error_m or 0.0)) if math.isfinite(one) or one == 0.0)
    half_m = next((one for one in RULERS_M if one >= 1.05 * widest), RULERS_M[-1])
    label = f" ±{half_m:g} m"
    count = max((width - len(label)) // 2 * 2 - 1, 11)
    cells = ["·"] * count

    def put(offset_m: float, mark: str) -> None:
        cells[min(max(round((offset_m / half_m + 1.0) / 2.0 * (count - 1)), 0), count - 1)] = mark

    first, last = (
        round((one / half_m + 1.0) / 2.0 * (count - 1)) for one in (-min(falling, half_m), min(rising, half_m))
    )
    for k in range(max(first, 0), min(last, count - 1) + 1):
        cells[k] = "─"
    put(-falling if math.isfinite(falling) else -half_m, "[")
    put(rising if math.isfinite(rising) else half_m, "]")
    put(0.0, "●")
    if view.error_m is not None:
        put(view.error_m, "×")
    return "".join(cells) + label


def _events(view: TrainView, now_s: float) -> list[RenderableType]:
    return [
        Text(f"{age_s:4.0f} s  {text}", style="" if age_s < 10.0 else "dim", no_wrap=True, overflow="ellipsis")  # noqa: PLR2004 - fresh
        for age_s, text in view.recent_events(now_s)
    ]


def plain_train_line(view: TrainView, now_s: float, language: Language) -> str:
    """The same in one line of text."""
    status = status_of(view, now_s)
    position = view.position if status != "stale" else None
    parts = [view.train, SHAPES[status][0], word(status if status != "lost" else "no_position", language)]
    if position is not None:
        parts += [_place(position), _bounds(position.bound_behind_m, position.bound_ahead_m)]
        parts.append(_speed(position))
        if view.error_m is not None:
            parts.append(f"{word('error', language)} {-view.error_m:+.1f} m")
        parts += [position.reason] if position.reason else []
    else:
        parts.append(f"{word('age', language)} {view.age_s(now_s):.1f} s")
    return "  ".join(parts)
