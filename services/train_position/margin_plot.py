"""The margin along the way (Iwata et al., figure 5 below), and errors against their bounds.

The same input gives the same bytes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from services.train_position.evaluation import Floats, Passes, Positions, Truth, judge

DOTS_PER_INCH: Final = 150
PAPER_SHARE: Final = 0.02
PAPER_SLIP_M: Final = 20.0
"""The paper's margin without landmarks: 2 % of the way and 20 m for one slip."""


def draw_margin(positions: Positions, truth: Truth, passes: Passes | None = None) -> Figure:
    """Margin and error against the way gone, and error against bound. Raises ValueError without common times."""
    found = judge(positions, truth)
    true_m = truth.at(positions.t_s)
    known = np.isfinite(positions.axis_m - true_m)
    t_s, true_m = positions.t_s[known], true_m[known]
    steps_m = np.abs(np.diff(true_m, prepend=true_m[0]))
    way_km = np.cumsum(np.where(steps_m < 30.0, steps_m, 0.0)) / 1000.0  # noqa: PLR2004 - a larger step is a change of cab
    error_m = positions.axis_m[known] - true_m
    ahead_m, behind_m = positions.ahead_m[known], positions.behind_m[known]
    figure = Figure(figsize=(10.0, 7.5), dpi=DOTS_PER_INCH, layout="constrained")
    grid = figure.add_gridspec(2, 3, height_ratios=(1.2, 1.0))
    saw = figure.add_subplot(grid[0, :])
    saw.plot(way_km, positions.margin_m[known], color="#1f5fa8", linewidth=1.2, label="margin published")
    saw.plot(
        way_km,
        PAPER_SHARE * 1000.0 * way_km + PAPER_SLIP_M,
        color="#888888",
        linestyle=(0, (5, 3)),
        linewidth=1.0,
        label="2 % + 20 m without landmarks",
    )
    saw.plot(way_km, np.abs(error_m), color="#c0392b", linewidth=0.9, label="error")
    if passes is not None and len(passes.t_s):
        for k, way in enumerate(np.interp(passes.t_s, t_s, way_km)):
            saw.axvline(way, color="#999999", linewidth=0.5, label="landmark or balise" if k == 0 else None)
    slipping = positions.slip[known]
    saw.fill_between(way_km, 0, 1, where=slipping, color="#f5c16c", alpha=0.5, transform=saw.get_xaxis_transform())
    saw.set_ylim(0.0, max(1.25 * float(positions.margin_m[known].max()), 10.0))
    saw.set_xlim(0.0, max(float(way_km[-1]), 0.1))
    saw.set_xlabel("way gone [km]")
    saw.set_ylabel("[m]")
    saw.set_title(
        f"{found.name}: margin {found.median_of_maxima_m:.0f} m median of maxima, "
        f"{found.largest_margin_m:.0f} m largest; "
        f"{found.within_percent:.2f} % of {found.compared} positions within their bound",
        fontsize=10,
    )
    saw.legend(loc="upper left", fontsize=8)
    signed = figure.add_subplot(grid[1, :2])
    signed.fill_between(way_km, -behind_m, ahead_m, color="#cfe0f3", label="bounds")
    signed.plot(way_km, -error_m * positions.sign[known], color="#c0392b", linewidth=0.9, label="truth minus estimate")
    signed.set_xlim(*saw.get_xlim())
    signed.set_xlabel("way gone [km]")
    signed.set_ylabel("ahead [m]")
    signed.legend(loc="upper left", fontsize=8)
    _draw_against(figure, grid[1, 2], np.abs(error_m), positions.margin_m[known])
    return figure


def _draw_against(figure: Figure, cell: object, error_m: Floats, bound_m: Floats) -> None:
    axes = figure.add_subplot(cell)  # type: ignore[call-overload]  # a cell of the grid
    top_m = 1.1 * max(float(bound_m.max()), float(error_m.max()), 1.0)
    axes.scatter(error_m, bound_m, s=2, color="#1f5fa8", alpha=0.3, linewidths=0, rasterized=True)
    axes.plot([0.0, top_m], [0.0, top_m], color="#333333", linewidth=1.0)
    axes.set_xlim(0.0, top_m)
    axes.set_ylim(0.0, top_m)
    axes.set_aspect("equal")
    axes.set_xlabel("error [m]")
    axes.set_ylabel("margin [m]")


def save_figure(figure: Figure, path: Path) -> None:
    """Write PNG or SVG, by the ending. Raises ValueError for another ending, OSError."""
    if path.suffix not in (".png", ".svg"):
        msg = f"{path}: write a picture as .png or .svg"
        raise ValueError(msg)
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    metadata = {"Date": None} if path.suffix == ".svg" else {"Software": None}
    try:
        with mpl.rc_context({"svg.hashsalt": "kirotei"}):
            FigureCanvasAgg(figure)
            figure.savefig(part, metadata=metadata)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
