"""A report's blocks on pages of a fixed size, each a figure: text and tables flow, pictures have pages of their own."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Final
from unicodedata import east_asian_width

from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from services.run_history.report_blocks import Block
from services.run_history.report_tables import Table

PAGE_INCHES: Final = (11.7, 8.3)
LINE: Final = 0.032
"""Of a page's height."""
TOP: Final = 0.93
BOTTOM: Final = 0.06
TABLE_ROWS: Final = 18
LINES_BELOW: Final = 12
WRAP: Final = 150
"""Narrow letters in a line of the page's width."""
PIECES: Final = re.compile(r"[\u2e80-\uffee]|[^\s\u2e80-\uffee]+\s*|\s+")


class _Sheets:
    """Text and tables that flow over pages; pictures have pages of their own, with the lines that follow them."""

    def __init__(self) -> None:
        self._figure, self._y, self._empty = Figure(figsize=PAGE_INCHES), TOP, True
        self._heading = ""

    def finish(self) -> Iterator[Figure]:
        """The page begun, if anything stands on it."""
        if not self._empty:
            yield self._figure
            self._figure, self._y, self._empty = Figure(figsize=PAGE_INCHES), TOP, True

    def take(self, block: Block) -> Iterator[Figure]:
        """Put a block of text or a table; gives the pages that became full."""
        if block.heading:
            if block.level == 1:
                yield from self._text([block.heading], 16)
            else:
                self._heading = block.heading
            return
        if block.lines or block.table is not None:
            heading, self._heading = self._heading, ""
            yield from self._text([heading] if heading else [], 12)
        yield from self._text(_wrapped((*block.lines, *block.beside), WRAP), 9)
        if block.table is not None:
            yield from self._table(block.table)

    def picture(self, block: Block, below: Block | None) -> Iterator[Figure]:
        """A picture with its heading, and lines below it, in two columns where there are two."""
        assert block.picture is not None  # noqa: S101 - only asked for pictures
        yield from self.finish()
        heading, self._heading = self._heading or block.caption, ""
        figure = block.picture()
        figure.set_size_inches(*PAGE_INCHES)
        columns = [] if below is None else [_wrapped(below.lines, WRAP)]
        if below is not None and below.beside:
            columns = [_wrapped(one, WRAP // 2) for one in (below.lines, below.beside)]
        most = max((len(one) for one in columns), default=0)
        height = LINE * (most + 1) if most else 0.0
        figure.set_layout_engine("constrained", rect=(0.03, 0.03 + height, 0.94, 0.90 - height))
        figure.text(0.05, 0.96, heading, fontsize=12, va="top")
        for column, lines in enumerate(columns):
            for number, line in enumerate(lines):
                left = 0.06 + 0.45 * column
                figure.text(left, height + 0.02 - LINE * number, line, fontsize=9, va="top")
        yield figure

    def _text(self, lines: Sequence[str], size: int) -> Iterator[Figure]:
        for line in lines:
            if self._y < BOTTOM + (3 * LINE if size > 9 else 0.0):  # noqa: PLR2004 - a heading keeps what follows
                yield from self.finish()
            self._figure.text(0.05, self._y, line, fontsize=size, va="top")
            self._y, self._empty = self._y - LINE * max(size / 9.0, 1.0), False

    def _table(self, table: Table) -> Iterator[Figure]:
        for first in range(0, max(1, len(table.rows)), TABLE_ROWS):
            part = Table(table.heads, table.rows[first : first + TABLE_ROWS])
            height = 1.15 * LINE * (len(part.rows) + 1)
            if self._y - height < BOTTOM:
                yield from self.finish()
            _draw_table(self._figure, part, self._y, height)
            self._y, self._empty = self._y - height - LINE, False


def pages_of(blocks: Iterable[Block]) -> Iterator[Figure]:
    """Pages of a report."""
    sheets = _Sheets()
    waiting: Block | None = None
    for block in blocks:
        if waiting is not None:
            taken = bool(block.lines) and max(len(block.lines), len(block.beside)) <= LINES_BELOW
            yield from sheets.picture(waiting, block if taken else None)
            waiting = None
            if taken:
                continue
        if block.picture is not None:
            waiting = block
        else:
            yield from sheets.take(block)
    if waiting is not None:
        yield from sheets.picture(waiting, None)
    yield from sheets.finish()


def _wrapped(lines: Iterable[str], wide: int) -> list[str]:
    """Lines broken to a width in narrow letters: at blanks, and between wide (Chinese and Japanese) letters."""
    found = []
    for line in lines:
        begun, taken = "", 0
        for piece in PIECES.findall(line):
            size = sum(2 if east_asian_width(letter) in "WF" else 1 for letter in piece)
            if begun and taken + size > wide:
                found.append(begun.rstrip())
                begun, taken = "", 0
            begun, taken = begun + piece, taken + size
        found.append(begun.rstrip())
    return found


def _draw_table(figure: Figure, part: Table, top: float, height: float) -> None:
    axes = figure.add_axes((0.05, top - height, 0.9, height))
    axes.axis("off")
    rows = [list(row) for row in part.rows] or [[""] * len(part.heads)]
    lengths = [max(len(row[k]) for row in (part.heads, *rows)) + 2 for k in range(len(part.heads))]
    table = axes.table(
        cellText=rows,
        colLabels=list(part.heads),
        colWidths=[length / sum(lengths) for length in lengths],
        cellLoc="left",
        bbox=Bbox.from_bounds(0.0, 0.0, 1.0, 1.0),
    )
    table.auto_set_font_size(False)  # noqa: FBT003 - matplotlib takes it by place
    table.set_fontsize(7)
    for (row, _), cell in table.get_celld().items():
        cell.set_linewidth(0.3)
        if row == 0:
            cell.set_facecolor("#f0f0f0")
