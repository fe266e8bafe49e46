"""Reports as files: HTML, PDF, and tables as CSV and Parquet; written beside and put in place.

The same report gives the same bytes.
Text in pictures stays text (selectable): SVG with `<text>`, PDF with TrueType fonts.
"""

from __future__ import annotations

import csv
import io
import secrets
import textwrap
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import duckdb
import matplotlib as mpl
from matplotlib import font_manager
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from services.run_history.report_blocks import Block, blocks_of
from services.run_history.report_html import page
from services.run_history.report_tables import Table, margin_columns, reception_columns, run_columns
from services.run_history.report_words import Language
from services.run_history.run_report import RunReport

CJK_FONTS: Final = ("Noto Sans CJK JP", "IPAexGothic", "IPAGothic", "Yu Gothic", "Hiragino Sans", "Noto Sans JP")
CJK_FILES: Final = ("notosanscjk-regular", "notosanscjkjp-regular", "notosansjp", "ipaexg", "ipag", "yugoth")
"""How files of such fonts begin."""
SALT_BYTES: Final = 32
PAGE_INCHES: Final = (11.7, 8.3)
LINE: Final = 0.032
"""Of a page's height."""
TOP: Final = 0.93
BOTTOM: Final = 0.06
TABLE_ROWS: Final = 18
LINES_BELOW: Final = 12
WRAP: Final = {"en": 150, "ja": 80}
NO_FONT: Final = "no Japanese font is installed (e.g. fonts-noto-cjk): the PDF is in English"

NO_FONT_NAMES: Final = "no Japanese font is installed (e.g. fonts-noto-cjk): names in Japanese are missing in the PDF"
FIRST_CJK: Final = "\u2e80"


class ReportFileError(ValueError):
    """A report that cannot be written so; the text says why."""


def cjk_font() -> str | None:
    """A font with Japanese that is installed here, or None.

    Looks into the system's fonts too: matplotlib's list of them may be older than the fonts.
    """
    installed = {font.name for font in font_manager.fontManager.ttflist}
    known = next((name for name in CJK_FONTS if name in installed), None)
    if known is not None:
        return known
    for path in sorted(font_manager.findSystemFonts()):
        if Path(path).name.lower().startswith(CJK_FILES):
            font_manager.fontManager.addfont(path)
            return font_manager.FontProperties(fname=path).get_name()
    return None


def salt_beside(out: Path) -> bytes:
    """The salt of pseudonyms beside a report, made when there is none, readable by its owner alone. Raises OSError."""
    path = out.with_name(f"{out.stem}.salt")
    try:
        salt = bytes.fromhex(path.read_text("ascii").strip())
    except FileNotFoundError:
        salt = secrets.token_bytes(SALT_BYTES)
        path.touch(mode=0o600, exist_ok=False)
        path.write_text(salt.hex() + "\n", "ascii")
    except ValueError as error:
        msg = f"{path}: no salt of pseudonyms (hexadecimal digits)"
        raise ReportFileError(msg) from error
    if len(salt) < SALT_BYTES // 2:
        msg = f"{path}: too short for a salt"
        raise ReportFileError(msg)
    return salt


def write_report(out: Path, report: RunReport, language: Language) -> str:
    """Write HTML or PDF by the ending; gives a note, or nothing. Raises ReportFileError, OSError."""
    match out.suffix.lower():
        case ".html" | ".htm":
            _write_html(out, report, language)
            return ""
        case ".pdf":
            fitting: Language = language if language == "en" or cjk_font() else "en"
            _write_pdf(out, report, fitting)
            if fitting != language:
                return NO_FONT
            return "" if cjk_font() or not _names_cjk(report) else NO_FONT_NAMES
        case other:
            msg = f"{out}: {other or 'no ending'} is none of .html, .pdf"
            raise ReportFileError(msg)


def _names_cjk(report: RunReport) -> bool:
    names = (name for one in report.sections for name in (one.group.start, one.group.end, one.group.series))
    return any(letter >= FIRST_CJK for name in names for letter in name)


@contextmanager
def _drawing() -> Iterator[None]:
    families = ["DejaVu Sans", *((font,) if (font := cjk_font()) else ())]
    settings: Any = {
        "font.family": families,
        "font.size": 9.0,
        "svg.fonttype": "none",
        "svg.hashsalt": "kirotei",
        "pdf.fonttype": 42,
        "text.parse_math": False,
    }
    with mpl.rc_context(settings), warnings.catch_warnings():
        # Without such a font a browser draws what is missing by its own, and the note tells it of a PDF.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        yield


def _write_html(out: Path, report: RunReport, language: Language) -> None:
    with _drawing():
        text = page(((block, _svg(block)) for block in blocks_of(report, language)), language)
    _put(out, text.encode())


def _svg(block: Block) -> str:
    if block.picture is None:
        return ""
    figure = block.picture()
    FigureCanvasAgg(figure)
    drawn = io.StringIO()
    figure.savefig(drawn, format="svg", metadata={"Date": None, "Creator": None})
    return drawn.getvalue()


def _write_pdf(out: Path, report: RunReport, language: Language) -> None:
    drawn = io.BytesIO()
    facts = {"CreationDate": None, "Title": "Kirotei"}
    with _drawing(), PdfPages(drawn, metadata=facts) as pages:
        for figure in _pages(blocks_of(report, language), WRAP[language]):
            FigureCanvasAgg(figure)
            pages.savefig(figure)
    _put(out, drawn.getvalue())


class _Sheets:
    """Text and tables that flow over pages; pictures have pages of their own, with the lines that follow them."""

    def __init__(self, wrap: int) -> None:
        self._wrap = wrap
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
        yield from self._text([part for line in block.lines for part in textwrap.wrap(line, self._wrap)], 9)
        if block.table is not None:
            yield from self._table(block.table)

    def picture(self, block: Block, below: Sequence[str]) -> Iterator[Figure]:
        """A picture with its heading, and lines below it."""
        assert block.picture is not None  # noqa: S101 - only asked for pictures
        yield from self.finish()
        heading, self._heading = self._heading or block.caption, ""
        figure = block.picture()
        figure.set_size_inches(*PAGE_INCHES)
        lines = [part for line in below for part in textwrap.wrap(line, self._wrap)]
        height = LINE * (len(lines) + 1) if lines else 0.0
        figure.set_layout_engine("constrained", rect=(0.03, 0.03 + height, 0.94, 0.90 - height))
        figure.text(0.05, 0.96, heading, fontsize=12, va="top")
        for number, line in enumerate(lines):
            figure.text(0.06, height + 0.02 - LINE * number, line, fontsize=9, va="top")
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


def _pages(blocks: Iterable[Block], wrap: int) -> Iterator[Figure]:
    """Pages of a report."""
    sheets = _Sheets(wrap)
    waiting: Block | None = None
    for block in blocks:
        if waiting is not None:
            taken = bool(block.lines) and len(block.lines) <= LINES_BELOW
            yield from sheets.picture(waiting, block.lines if taken else ())
            waiting = None
            if taken:
                continue
        if block.picture is not None:
            waiting = block
        else:
            yield from sheets.take(block)
    if waiting is not None:
        yield from sheets.picture(waiting, ())
    yield from sheets.finish()


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


def write_tables(out: Path, report: RunReport) -> list[Path]:
    """Margins, runs and reception as CSV and Parquet beside a report; gives the files. Raises OSError."""
    written = []
    for columns in (margin_columns(report), run_columns(report), reception_columns(report)):
        if not columns.rows:
            continue
        path = out.with_name(f"{out.stem}.{columns.name}.csv")
        text = io.StringIO()
        writer = csv.writer(text)
        writer.writerow(columns.heads)
        writer.writerows([_plain(cell) for cell in row] for row in columns.rows)
        _put(path, text.getvalue().encode())
        written += [path, _write_parquet(path)]
    return written


def _plain(cell: object) -> object:
    return f"{cell:.6g}" if isinstance(cell, float) and abs(cell) < 1e6 else cell  # noqa: PLR2004 - Unix times stay whole


def _write_parquet(path: Path) -> Path:
    parquet = path.with_suffix(".parquet")
    beside = parquet.with_name(parquet.name + ".part")
    with duckdb.connect() as connection:
        connection.execute("SET threads=1")
        connection.execute(
            f"COPY (SELECT * FROM read_csv(?, header=true, sample_size=-1)) TO '{_quoted(beside)}' (FORMAT parquet)",  # noqa: S608 - COPY takes no parameter for its target; quoted
            [str(path)],
        )
    beside.replace(parquet)
    return parquet


def _quoted(path: Path) -> str:
    return str(path).replace("'", "''")


def _put(path: Path, content: bytes) -> None:
    beside = path.with_name(path.name + ".part")
    try:
        beside.write_bytes(content)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
