"""A line drawn: curvature, gradient with height, speed limit, and the plan. The same line gives the same bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final
from warnings import catch_warnings, filterwarnings

import matplotlib as mpl
import numpy as np
from matplotlib import font_manager
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from schemas.line import Line
from services.line.alignment import Alignment, alignment_of, routes

STEP_M: Final = 5.0
WIDTH_IN: Final = 14.0
HEIGHT_IN: Final = 11.0
DOTS_PER_INCH: Final = 110
FONTS: Final = ("DejaVu Sans", "Noto Sans CJK JP", "IPAexGothic", "Hiragino Sans", "Yu Gothic")
"""The first comes with matplotlib; the others write Japanese names, where they are installed."""
SHADES: Final = {
    "tunnel": "#5a5a5a",
    "cutting": "#b08d57",
    "canyon": "#a3a3c2",
    "station_roof": "#d9a5a5",
    "forest": "#8fbc8f",
}
INK: Final = "#24305e"
ACCENT: Final = "#d2691e"


def draw_line(path: Path, line: Line, alignment: Alignment) -> None:
    """Draw a route into a picture file, its kind by its ending. Raises OSError, and ValueError for an unknown kind."""
    installed = {font.name for font in font_manager.fontManager.ttflist}
    usable = [name for name in FONTS if name in installed]
    settings: dict[Any, Any] = {"font.family": usable, "svg.hashsalt": "kirotei", "axes.grid": True, "grid.alpha": 0.3}
    with mpl.rc_context(settings), catch_warnings():
        filterwarnings("ignore", message="Glyph .* missing", category=UserWarning)
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), layout="constrained")
        FigureCanvasAgg(figure)
        curvature, gradient, limit, plan = figure.subplots(4, 1, height_ratios=(1.2, 1.2, 0.8, 2.4))
        along = np.arange(0.0, alignment.length_m, STEP_M)
        route = f", branch {alignment.branch}" if alignment.branch else ""
        japanese = len(usable) > 1
        figure.suptitle(f"{_named(line.name, line.name_ja, japanese=japanese)}{route}")
        _curvature(curvature, alignment, along, japanese=japanese)
        _gradient(gradient, alignment, along)
        _limit(limit, alignment, along)
        _plan(plan, line, alignment)
        for axes in (curvature, gradient, limit):
            axes.set_xlim(0.0, alignment.length_m / 1000.0)
        limit.set_xlabel("axis_m [km]")
        part = path.with_name(f".{path.stem}.part{path.suffix}")
        try:
            kept = {"Software": None} if path.suffix.lower() == ".png" else {"Date": None}
            figure.savefig(part, dpi=DOTS_PER_INCH, metadata=kept if path.suffix.lower() in (".png", ".svg") else None)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)


def _named(name: str, name_ja: str, *, japanese: bool) -> str:
    """A name with the Japanese one, where a font can write it."""
    return f"{name} {name_ja}" if japanese and name_ja and name_ja != name else name


def _curvature(
    axes: Axes, alignment: Alignment, along: np.ndarray[tuple[int], np.dtype[np.float64]], *, japanese: bool
) -> None:
    """Curvature with landmarks, over what stands around the line."""
    for one in alignment.surroundings_along:
        axes.axvspan(one.start_axis_m / 1000.0, one.end_axis_m / 1000.0, color=SHADES[one.kind], alpha=0.25, lw=0.0)
    axes.plot(along / 1000.0, 1000.0 * alignment.curvature_per_m(along), color=INK, lw=1.0)
    exits = [one.exit_lower_limit_m for one in alignment.landmarks]
    if exits:
        height = 1000.0 * alignment.curvature_per_m(exits)
        axes.plot(np.array(exits) / 1000.0, height, ".", color=ACCENT, ms=5, label="landmark crossings")
        axes.legend(loc="upper right")
    axes.set_ylabel("curvature [1/km]\nleft is up")
    for station in alignment.stations:
        axes.annotate(
            _named(station.name, station.name_ja, japanese=japanese),
            (station.axis_m / 1000.0, 1.0),
            xycoords=("data", "axes fraction"),
            rotation=30,
            fontsize=8,
            ha="left",
            va="bottom",
        )


def _gradient(axes: Axes, alignment: Alignment, along: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
    """Gradient, and height on the other scale."""
    axes.fill_between(along / 1000.0, alignment.gradient_permille(along), color=ACCENT, alpha=0.5, lw=0.0)
    axes.set_ylabel("gradient [‰]\nuphill is up")
    other = axes.twinx()
    other.plot(along / 1000.0, alignment.position(along)[2], color=INK, lw=1.0)
    other.set_ylabel("height [m]")
    other.grid(visible=False)


def _limit(axes: Axes, alignment: Alignment, along: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
    """Speed limit, nothing where none is stated."""
    limit = alignment.speed_limit_mps(along) * 3.6
    axes.plot(along / 1000.0, np.where(np.isfinite(limit), limit, np.nan), color=INK, lw=1.0, drawstyle="steps-post")
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("limit [km/h]")


def _plan(axes: Axes, line: Line, alignment: Alignment) -> None:
    """Every route from above, the one shown on top."""
    for route in routes(line):
        if route != alignment.branch:
            east, north = alignment_of(line, route).axis.plane_m.T / 1000.0
            axes.plot(east, north, color="#9a9a9a", lw=1.0)
    east, north = alignment.axis.plane_m.T / 1000.0
    axes.plot(east, north, color=INK, lw=1.5)
    for station in alignment.stations:
        place = [float(np.interp(station.axis_m, alignment.axis.axis_m, one)) for one in (east, north)]
        axes.plot(*place, "o", color=ACCENT, ms=4)
        axes.annotate(f" {station.name}", (place[0], place[1]), fontsize=8)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east [km]")
    axes.set_ylabel("north [km]")
