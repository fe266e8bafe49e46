"""The terminal view of trains and services, from what is known of them. Pure rendering.

Every status has a shape and a word beside its colour.
"""

from __future__ import annotations

from dataclasses import dataclass

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from services.runtime.sparkline import Sparkline
from services.runtime.watch_state import DeviceView, MethodView, ServiceView, WatchState
from services.runtime.watch_trains_view import plain_train_line, train_panel
from services.runtime.watch_words import Language, word

CHART_S = 60.0
MINUTE_COLUMNS = 16
"""A long reason wraps rather than squeeze the chart further."""
LEAST_TOP_M = 5.0
"""A chart's full height is never less than this, so that small errors look small."""
REASON_CHARACTERS = 60
COLUMNS: tuple[tuple[int, tuple[str, ...]], ...] = (
    (112, ("method", "status", "age", "lat", "lon", "used", "flagged", "error", "mean", "q95", "minute")),
    (84, ("method", "status", "age", "used", "flagged", "error", "mean", "q95", "minute")),
    (64, ("method", "status", "age", "error", "mean", "q95", "minute")),
    (0, ("method", "status", "age", "error")),
)
"""Least width and what is shown from there on; how a fix stands and how old it is never goes."""
FIX_SHAPES = {"fix": ("●", "green"), "predicted": ("▲", "yellow"), "none": ("■", "red"), "stale": ("◇", "magenta")}
LEVEL_SHAPES = {"ok": ("●", "green"), "degraded": ("▲", "yellow"), "failed": ("■", "red"), "lost": ("◇", "magenta")}


def render(state: WatchState, now_s: float, language: Language = "en") -> RenderableType:
    """Everything on one screen at a moment."""
    parts: list[RenderableType] = [Text(f"Kirotei  {word('line', language, line=state.line)}", style="bold")]
    parts.extend(
        train_panel(train, now_s, language)
        for _, train in sorted(state.trains.items())
        if train.position or train.events
    )
    for _, device in sorted(state.devices.items()):
        if device.methods:
            parts.append(_device_panel(device, now_s, language))
    if state.services:
        parts.append(_services_panel(list(state.services.values()), now_s, language))
    if len(parts) == 1:
        parts.append(Text(word("nothing", language), style="dim"))
    if state.crowded:
        parts.append(Text(f"▲ {word('crowded', language)}", style="yellow"))
    return Group(*parts)


@dataclass(frozen=True, slots=True)
class _DeviceTable:
    """Table of one receiver's methods; where the terminal is narrow the less important columns go."""

    device: DeviceView
    now_s: float
    language: Language

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """The table, for the width at hand."""
        del console
        names = next(columns for least, columns in COLUMNS if options.max_width >= least)
        rows = self.device.ordered()
        top_m = max([LEAST_TOP_M, *(error for row in rows for at_s, error in row.errors if at_s >= self._from_s)])
        table = Table(box=None, expand=True, pad_edge=False)
        for name in names:
            title = word(name, self.language, top=top_m)
            right = name not in ("method", "status", "minute")
            table.add_column(
                title,
                justify="right" if right else "left",
                no_wrap=name != "status",
                ratio=1 if name == "minute" else None,
                min_width=MINUTE_COLUMNS if name == "minute" else None,
            )
        for row in rows:
            cells = _method_cells(row, self.now_s, self.language)
            cells["minute"] = Sparkline(list(row.errors), self._from_s, self.now_s, top_m, "cyan")
            table.add_row(*(cells[name] for name in names))
        yield table

    @property
    def _from_s(self) -> float:
        return self.now_s - CHART_S


def _device_panel(device: DeviceView, now_s: float, language: Language) -> RenderableType:
    title = word("train", language, train=device.train, device=device.device)
    around = device.surroundings(now_s)
    table = _DeviceTable(device, now_s, language)
    return Panel(table, title=Text(f"{title} · {around}" if around else title), title_align="left")


def fix_status(row: MethodView, now_s: float) -> str:
    """'fix', 'predicted' or 'none' as the newest message says, 'stale' when it is old."""
    return "stale" if row.stale(now_s) or row.fix is None else row.fix.status


def _method_cells(row: MethodView, now_s: float, language: Language) -> dict[str, RenderableType]:
    """Cells by column."""
    status = fix_status(row, now_s)
    shape, colour = FIX_SHAPES[status]
    fix = row.fix if status != "stale" else None
    told = f"{shape} {word(status, language)}"
    if fix is not None and fix.reason:
        told += f": {fix.reason[:REASON_CHARACTERS]}"
    name = f"{word(row.method, language)}{' *' if row.primary else ''}"
    return {
        "method": Text(name, style="bold" if row.primary else ""),
        "status": Text(told, style=colour),
        "age": Text(_age(row.age_s(now_s)), style="bold magenta" if status == "stale" else ""),
        "lat": Text(_degrees(fix.lat_deg if fix else None)),
        "lon": Text(_degrees(fix.lon_deg if fix else None)),
        "used": Text(str(fix.satellites_used) if fix else "-"),
        "flagged": Text(str(fix.satellites_flagged) if fix else "-"),
        "error": Text(_metres(row.error_m if fix else None)),
        "mean": Text(_metres(row.mean_m())),
        "q95": Text(_metres(row.quantile_m(0.95))),
    }


def service_level(view: ServiceView, now_s: float) -> str:
    """The level that a service reports, or 'lost' when it reports no more."""
    return "lost" if view.lost(now_s) else view.health.level


def _services_panel(views: list[ServiceView], now_s: float, language: Language) -> RenderableType:
    table = Table(box=None, expand=True, pad_edge=False)
    for name in ("service", "level", "age", "rate", "gaps", "dropped", "restarts", "reasons"):
        right = name in ("age", "rate", "gaps", "dropped", "restarts")
        table.add_column(word(name, language), justify="right" if right else "left", no_wrap=name != "reasons")
    for view in sorted(views, key=lambda view: view.source):
        level = service_level(view, now_s)
        shape, colour = LEVEL_SHAPES[level]
        rate = "-" if view.rate_hz is None or level == "lost" else f"{view.rate_hz:.1f}"
        table.add_row(
            Text(view.source.partition("/")[2]),
            Text(f"{shape} {word(level, language)}", style=colour),
            Text(_age(view.age_s(now_s)), style="bold magenta" if level == "lost" else ""),
            rate,
            str(view.missing()),
            str(view.health.dropped),
            str(view.restarts),
            Text("; ".join(view.health.reasons)),
        )
    return Panel(table, title=word("services", language), title_align="left")


def plain_lines(state: WatchState, now_s: float, language: Language = "en") -> list[str]:
    """The same in lines of text, for pipes and logs: every method, and every service that is not well."""
    lines = [plain_train_line(train, now_s, language) for _, train in sorted(state.trains.items()) if train.position]
    for _, device in sorted(state.devices.items()):
        for row in device.ordered():
            status = fix_status(row, now_s)
            fix = row.fix
            parts = [f"{device.train}/{device.device}", row.method, FIX_SHAPES[status][0], word(status, language)]
            parts.append(f"{word('age', language)} {_age(row.age_s(now_s))}")
            if fix is not None and status != "stale":
                parts += [_degrees(fix.lat_deg), _degrees(fix.lon_deg)]
                parts.append(f"{word('used', language)} {fix.satellites_used}")
                parts.append(f"{word('flagged', language)} {fix.satellites_flagged}")
                parts.append(f"{word('error', language)} {_metres(row.error_m)}")
                parts += [fix.reason] if fix.reason else []
            parts.append(f"{word('mean', language)} {_metres(row.mean_m())}")
            parts.append(f"{word('q95', language)} {_metres(row.quantile_m(0.95))}")
            lines.append("  ".join(parts))
    for view in sorted(state.services.values(), key=lambda view: view.source):
        level = service_level(view, now_s)
        if level != "ok":
            why = "; ".join(view.health.reasons)
            told = (
                f"{LEVEL_SHAPES[level][0]} {word(level, language)}  {word('age', language)} {_age(view.age_s(now_s))}"
            )
            lines.append(f"{view.source.partition('/')[2]}  {told}  {why}".rstrip())
    return lines


def _age(seconds: float) -> str:
    """Age in words that stay short.

    >>> _age(0.23), _age(75.0), _age(7300.0)
    ('0.2 s', '75 s', '122 min')
    """
    if seconds < 10.0:  # noqa: PLR2004 - tenths matter while a fix is fresh
        return f"{max(0.0, seconds):.1f} s"
    return f"{seconds:.0f} s" if seconds < 600.0 else f"{seconds / 60.0:.0f} min"  # noqa: PLR2004 - ten minutes


def _degrees(value: float | None) -> str:
    return "-" if value is None else f"{value:.6f}"


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f} m"
