"""What pictures of motion, landmarks and position have in common: heads of panels, and how they are written.

The same figure gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Final

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

DOTS_PER_INCH: Final = 110
WIDTH_IN: Final = 11.0
COLOURS_KEPT: Final = 256
"""Lines and flat areas need no more; a file is a third of what it would be in full colour."""


def head(axes: Axes, title: str, handles: Sequence[Artist] | None = None) -> None:
    """Grid, title on the left and legend on the right, both above the curves, so that they cover none.

    The legend is of everything that has a label, or of `handles` alone; empty ones give none.
    """
    axes.set_title(title, fontsize=10, loc="left", fontweight="bold")
    axes.grid(visible=True, color="#e2e2e2", linewidth=0.6)
    axes.set_axisbelow(True)
    shown = axes.get_legend_handles_labels()[0] if handles is None else handles
    if not shown:
        return
    axes.legend(
        handles=list(shown),
        fontsize=8,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=9,
        frameon=False,
        borderaxespad=0.15,
        columnspacing=1.1,
        handletextpad=0.5,
    )


def caption(figure: Figure, words: str) -> None:
    """What the whole picture shows, above all panels."""
    figure.suptitle(words, fontsize=10, x=0.01, ha="left")


def save_picture(path: Path, figure: Figure) -> None:
    """Write PNG or SVG, by the ending, whole or not at all. Raises ValueError for another ending, OSError."""
    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg"):
        msg = f"{path}: a picture is written as .png or .svg"
        raise ValueError(msg)
    drawn = BytesIO()
    with mpl.rc_context({"svg.hashsalt": "kirotei", "svg.fonttype": "none"}):
        FigureCanvasAgg(figure)
        figure.savefig(drawn, format=kind, metadata={"Date": None} if kind == "svg" else {"Software": None})
    part = path.with_name(f".{path.name}.part")
    try:
        part.write_bytes(drawn.getvalue() if kind == "svg" else _indexed(drawn))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _indexed(drawn: BytesIO) -> bytes:
    """The PNG with a palette in place of full colour."""
    small = BytesIO()
    with Image.open(drawn) as image:
        image.convert("RGB").quantize(COLOURS_KEPT, dither=Image.Dither.NONE).save(small, "png", optimize=True)
    return small.getvalue()
