"""The map of a run: fixes of every method beside the line, as Figures 7 and 8 of Yoshinaga et al. 2008.

Before correction dark, kept after removal light, adjusted pink. The same input gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from warnings import catch_warnings, filterwarnings

import matplotlib as mpl
import numpy as np
from matplotlib import font_manager
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from services.gnss_correction.evaluation import FixTrack, Float64s, Polyline, horizontal_m
from services.numerics.geodesy import enu_about

MARGIN_M: Final = 60.0
"""Around the line; fixes further out are counted, not drawn."""
LONGER_SIDE_IN: Final = 11.0
SHORTER_SIDE_IN: Final = 5.0
DOTS_PER_INCH: Final = 150
FONTS: Final = ("DejaVu Sans", "Noto Sans CJK JP", "IPAexGothic", "Hiragino Sans", "Yu Gothic")
"""The first comes with matplotlib; the others write Japanese names, where they are installed."""
_NICE: Final = (1.0, 2.0, 5.0)


@dataclass(frozen=True, slots=True)
class _Look:
    colour: str
    marker: str
    size: float
    order: int


_LOOKS: Final = {
    "original": _Look("#24305e", "o", 9.0, 3),
    "remove": _Look("#38b6e0", "o", 9.0, 4),
    "adjust": _Look("#e8479b", "o", 9.0, 5),
}
_OTHERS: Final = (_Look("#2e8b57", "s", 8.0, 6), _Look("#d2691e", "^", 8.0, 7), _Look("#7b5ea7", "D", 7.0, 8))


def _looks(names: Sequence[str]) -> list[_Look]:
    """Look of each method: by the paper's method in its name, else from the other colours in turn."""
    looks, others = [], 0
    for name in names:
        known = [look for method, look in _LOOKS.items() if method in name and look not in looks]
        if known:
            looks.append(known[0])
        else:
            looks.append(_OTHERS[others % len(_OTHERS)])
            others += 1
    return looks


def _nice_length_m(whole_m: float) -> float:
    """Round length of about a fifth of the whole."""
    power = 10.0 ** np.floor(np.log10(whole_m / 5.0))
    return float(max(nice * power for nice in _NICE if nice * power <= whole_m / 5.0))


def _scale_bar(axes: Axes, low: Float64s, high: Float64s) -> None:
    """Length and north in the lower left corner, inside the frame."""
    length_m = _nice_length_m(float(high[0] - low[0]))
    corner = low + 0.04 * (high - low).min()
    axes.plot(
        [corner[0], corner[0] + length_m], [corner[1]] * 2, color="black", linewidth=3, solid_capstyle="butt", zorder=9
    )
    axes.annotate(
        f"{length_m:g} m",
        (corner[0] + length_m / 2, corner[1]),
        (0, 5),
        textcoords="offset points",
        ha="center",
        fontsize=9,
    )
    axes.annotate(
        "N",
        (0.965, 0.90),
        (0.965, 0.97),
        xycoords="axes fraction",
        ha="center",
        va="center",
        fontsize=10,
        arrowprops={"arrowstyle": "<|-", "color": "black"},
    )


def _draw_line(axes: Axes, line_m: Float64s, name: str) -> None:
    """A railway as on maps: a dark line with light dashes on it."""
    axes.plot(*line_m.T, color="#555555", linewidth=4.0, zorder=1, label=name, solid_joinstyle="round")
    axes.plot(*line_m.T, color="white", linewidth=2.4, zorder=2, linestyle=(0, (3, 3)))


def _frame(axes: Axes, everything_m: Float64s) -> tuple[Float64s, Float64s]:
    """Equal axes around all that must be seen."""
    low, high = everything_m.min(axis=0) - MARGIN_M, everything_m.max(axis=0) + MARGIN_M
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.set_xlabel("east [m]")
    axes.set_ylabel("north [m]")
    axes.grid(color="#e4e4e4", linewidth=0.6, zorder=0)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_color("#999999")
    return low, high


def _draw_fixes(
    axes: Axes, tracks: Sequence[FixTrack], reference_deg: tuple[float, float, float], low: Float64s, high: Float64s
) -> None:
    for track, look in zip(tracks, _looks([track.name for track in tracks]), strict=True):
        points = horizontal_m(track, reference_deg)[track.fixed]
        outside = int(((points < low) | (points > high)).any(axis=1).sum())
        label = f"{track.name}: {len(points)} of {len(track.t_s)} epochs" + (
            f", {outside} off the map" if outside else ""
        )
        axes.scatter(
            points[:, 0],
            points[:, 1],
            s=look.size,
            c=look.colour,
            marker=look.marker,
            linewidths=0,
            alpha=0.75,
            zorder=look.order,
            label=label,
        )


def _draw_stations(
    axes: Axes, stations: Sequence[tuple[str, float, float]], reference_deg: tuple[float, float, float]
) -> None:
    for name, lat_deg, lon_deg in stations:
        east, north = enu_about(reference_deg, lat_deg, lon_deg, reference_deg[2])[:2]
        axes.scatter([east], [north], s=70, c="white", marker="s", edgecolors="black", linewidths=1.4, zorder=10)
        axes.annotate(
            name, (east, north), (7, 6), textcoords="offset points", fontsize=10, fontweight="bold", zorder=11
        )


def _middle(track: FixTrack) -> tuple[float, float, float]:
    """Median of a track's fixes, as a reference."""
    columns = (track.lat_deg, track.lon_deg, track.h_m)
    lat_deg, lon_deg, h_m = (float(np.median(column[track.fixed])) for column in columns)
    return lat_deg, lon_deg, h_m


def draw_tracks(
    tracks: Sequence[FixTrack],
    line: Polyline | None,
    truth: Polyline | None,
    stations: Sequence[tuple[str, float, float]],
) -> Figure:
    """Figure of the fixes of several methods, the line, the truth where there is no line, and stations.

    Raises ValueError when there is nothing to draw around.
    """
    base = line or truth
    fixed = [track for track in tracks if track.fixed.any()]
    if base is not None:
        reference = base.reference_deg
        around = horizontal_m(base, reference)
    elif fixed:
        reference = _middle(fixed[0])
        around = np.vstack([horizontal_m(one, reference)[one.fixed] for one in fixed])
    else:
        msg = "there is neither a line nor a fix to draw"
        raise ValueError(msg)
    size = around.max(axis=0) - around.min(axis=0) + 2.0 * MARGIN_M
    width_in, height_in = np.clip(LONGER_SIDE_IN * size / size.max(), SHORTER_SIDE_IN, LONGER_SIDE_IN)
    figure = Figure(figsize=(width_in + 0.8, height_in + 1.2), dpi=DOTS_PER_INCH, layout="constrained")
    axes = figure.add_subplot()
    low, high = _frame(axes, around)
    if base is not None:
        _draw_line(axes, around, "line" if line else "truth")
    _draw_fixes(axes, tracks, reference, low, high)
    _draw_stations(axes, stations, reference)
    _scale_bar(axes, low, high)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=10, markerscale=2.2)
    return figure


def save_tracks(
    path: Path,
    tracks: Sequence[FixTrack],
    line: Polyline | None = None,
    truth: Polyline | None = None,
    stations: Sequence[tuple[str, float, float]] = (),
) -> None:
    """Write the map as PNG or SVG, by the extension of `path`. Raises ValueError, OSError."""
    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg"):
        msg = f"{path}: a plot is .png or .svg"
        raise ValueError(msg)
    part = path.with_name(f".{path.name}.part")
    installed = font_manager.fontManager.get_font_names()
    families = [name for name in FONTS if name in installed]
    with mpl.rc_context({"svg.hashsalt": "kirotei", "svg.fonttype": "none", "font.family": families}), catch_warnings():
        # A name that no installed font can write stays right in an SVG, and shows boxes in a PNG.
        filterwarnings("ignore", message="Glyph .* missing from font")
        figure = draw_tracks(tracks, line, truth, stations)
        FigureCanvasAgg(figure)
        try:
            figure.savefig(part, format=kind, metadata={"Date": None} if kind == "svg" else {"Software": None})
            part.replace(path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
