"""A small chart in one line of text. Pure."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.segment import Segment

BLOCKS = "▁▂▃▄▅▆▇█"
NO_VALUE = "·"


def buckets(points: Iterable[tuple[float, float]], from_s: float, to_s: float, count: int) -> list[float | None]:
    """Largest value in each of `count` equal stretches of time; None where there is none."""
    tops: list[float | None] = [None] * count
    for at_s, value in points:
        index = int((at_s - from_s) / (to_s - from_s) * count)
        if 0 <= index < count and at_s >= from_s:
            top = tops[index]
            tops[index] = value if top is None or value > top else top
    return tops


def spark(values: Iterable[float | None], top: float) -> str:
    """Characters whose height tells the value, full height at `top` and above.

    >>> spark([0.0, 5.0, 10.0, None, 99.0], 10.0)
    '▁▅█·█'
    """
    return "".join(
        NO_VALUE if value is None else BLOCKS[min(len(BLOCKS) - 1, max(0, int(value / top * len(BLOCKS))))]
        for value in values
    )


class Sparkline:
    """Chart of points over a stretch of time, as wide as its cell allows (8 to 60 characters)."""

    def __init__(self, points: list[tuple[float, float]], from_s: float, to_s: float, top: float, style: str) -> None:
        """Hold (time [s], value) points; `top` is the value at full height."""
        self._points = points
        self._span_s = (from_s, to_s)
        self._top = top
        self._style = style

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        """Width that it can take."""
        del console
        return Measurement(min(8, options.max_width), min(60, options.max_width))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """One line."""
        width = min(60, options.max_width)
        text = spark(buckets(self._points, *self._span_s, width), self._top)
        yield Segment(text, console.get_style(self._style))
