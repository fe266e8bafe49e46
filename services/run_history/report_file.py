"""Reports as files: HTML, PDF, and tables as CSV and Parquet; written beside and put in place.

The same report gives the same bytes.
Text in pictures stays text (selectable): SVG with `<text>`, PDF with TrueType fonts.
"""

from __future__ import annotations

import csv
import io
import secrets
import textwrap
from collections.abc import Iterable, Iterator
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
SALT_BYTES: Final = 32
PAGE_INCHES: Final = (11.7, 8.3)
LINE: Final = 0.032
"""Of a page's height."""
TOP: Final = 0.93
BOTTOM: Final = 0.06
WRAP: Final = {"en": 150, "ja": 80}
NO_FONT: Final = "no Japanese font is installed (e.g. fonts-noto-cjk): the PDF is in English"


class ReportFileError(ValueError):
    """A report that cannot be written so; the text says why."""


def cjk_font() -> str | None:
    """A font with Japanese that is installed here, or None."""
    installed = {font.name for font in font_manager.fontManager.ttflist}
    return next((name for name in CJK_FONTS if name in installed), None)


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


def write_report(out: Path, report: RunReport, language: Language, sheets: int) -> str:
    """Write HTML or PDF by the ending; gives a note, or nothing. Raises ReportFileError, OSError."""
    match out.suffix.lower():
        case ".html" | ".htm":
            _write_html(out, report, language, sheets)
            return ""
        case ".pdf":
            fitting: Language = language if language == "en" or cjk_font() else "en"
            _write_pdf(out, report, fitting, sheets)
            return NO_FONT if fitting != language else ""
        case other:
            msg = f"{out}: {other or 'no ending'} is none of .html, .pdf"
            raise ReportFileError(msg)


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
    with mpl.rc_context(settings):
        yield


def _write_html(out: Path, report: RunReport, language: Language, sheets: int) -> None:
    with _drawing():
        text = page(((block, _svg(block)) for block in blocks_of(report, language, sheets)), language)
    _put(out, text.encode())


def _svg(block: Block) -> str:
    if block.picture is None:
        return ""
    figure = block.picture()
    FigureCanvasAgg(figure)
    drawn = io.StringIO()
    figure.savefig(drawn, format="svg", metadata={"Date": None, "Creator": None})
    return drawn.getvalue()


def _write_pdf(out: Path, report: RunReport, language: Language, sheets: int) -> None:
    drawn = io.BytesIO()
    facts = {"CreationDate": None, "Title": "Kirotei"}
    with _drawing(), PdfPages(drawn, metadata=facts) as pages:
        for figure in _pages(blocks_of(report, language, sheets), WRAP[language]):
            FigureCanvasAgg(figure)
            pages.savefig(figure)
    _put(out, drawn.getvalue())


def _pages(blocks: Iterable[Block], wrap: int) -> Iterator[Figure]:
    """Text and tables flow over pages; each picture has its own under the text before it."""
    figure, y = Figure(figsize=PAGE_INCHES), TOP
    empty = True
    for block in blocks:
        if block.picture is not None:
            if not empty:
                yield figure
            yield block.picture()
            figure, y, empty = Figure(figsize=PAGE_INCHES), TOP, True
            continue
        if block.table is not None:
            for first in range(0, max(1, len(block.table.rows)), 18):
                part = Table(block.table.heads, block.table.rows[first : first + 18])
                height = LINE * 1.15 * (len(part.rows) + 1)
                if y - height < BOTTOM:
                    yield figure
                    figure, y = Figure(figsize=PAGE_INCHES), TOP
                _draw_table(figure, part, y, height)
                y, empty = y - height - LINE, False
            continue
        size = (16 if block.level == 1 else 12) if block.heading else 9
        lines = [part for line in (block.heading, *block.lines) if line for part in textwrap.wrap(line, wrap)]
        for line in lines:
            if y < BOTTOM + 3 * LINE * bool(block.heading):
                yield figure
                figure, y = Figure(figsize=PAGE_INCHES), TOP
            figure.text(0.05, y, line, fontsize=size, va="top")
            y, empty = y - LINE * size / 9.0, False
    if not empty:
        yield figure


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
