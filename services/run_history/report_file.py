"""Reports as files: HTML, PDF, and tables as CSV and Parquet; written beside and put in place.

The same report gives the same bytes.
Text in pictures stays text (selectable): SVG with `<text>`, PDF with TrueType fonts.
"""

from __future__ import annotations

import csv
import io
import secrets
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import duckdb
import matplotlib as mpl
from matplotlib import font_manager
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages

from services.run_history.report_blocks import Block, blocks_of
from services.run_history.report_html import page
from services.run_history.report_pages import pages_of
from services.run_history.report_tables import margin_columns, reception_columns, run_columns
from services.run_history.report_words import Language
from services.run_history.run_report import RunReport

CJK_FONTS: Final = ("Noto Sans CJK JP", "IPAexGothic", "IPAGothic", "Yu Gothic", "Hiragino Sans", "Noto Sans JP")
CJK_FILES: Final = ("notosanscjk-regular", "notosanscjkjp-regular", "notosansjp", "ipaexg", "ipag", "yugoth")
"""How files of such fonts begin."""
SALT_BYTES: Final = 32
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
        for figure in pages_of(blocks_of(report, language)):
            FigureCanvasAgg(figure)
            pages.savefig(figure)
    _put(out, drawn.getvalue())


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
