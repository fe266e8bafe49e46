"""The Stanford diagram: bounds against errors, epoch by epoch, with what each corner means.

The same input gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from services.gnss_correction.integrity import BoundedErrors, integrity_of

PANEL_IN: Final = 5.4
BINS: Final = 80
DOTS_PER_INCH: Final = 150
ROOM: Final = 1.15
"""The axes reach so far beyond the largest value,"""
LARGEST_BOUND: Final = 4.0
"""but bounds beyond so many alert limits, which are of no use anyhow, do not stretch them."""
SMALLEST: Final = 1.6
"""They reach at least so many alert limits, so that every region has room for its name."""


def _shade(axes: Axes, top_m: float, alert_limit_m: float) -> None:
    """Colours and names of the regions."""
    limit = alert_limit_m
    axes.fill([0, limit, limit], [0, limit, 0], color="#f7c9c4", zorder=0)
    axes.fill([limit, top_m, top_m, limit], [0, 0, limit, limit], color="#ec8f86", zorder=0)
    axes.fill([limit, top_m, top_m], [limit, top_m, limit], color="#f7dcc4", zorder=0)
    axes.fill([0, 0, top_m, limit], [limit, top_m, top_m, limit], color="#fdf3cf", zorder=0)
    axes.fill([0, 0, limit], [0, limit, limit], color="#e3f1e3", zorder=0)
    axes.plot([0, top_m], [0, top_m], color="#333333", linewidth=1.0, zorder=3)
    for ends in (([0.0, top_m], [limit, limit]), ([limit, limit], [0.0, top_m])):
        axes.plot(*ends, color="#333333", linewidth=0.8, linestyle=(0, (4, 3)), zorder=3)


def _draw_panel(axes: Axes, track: BoundedErrors, top_m: float, alert_limit_m: float) -> None:
    _shade(axes, top_m, alert_limit_m)
    bounded = np.isfinite(track.bound_m)
    edges = np.linspace(0.0, top_m, BINS + 1)
    # What lies beyond the axes is drawn at their ends.
    errors_m, bounds_m = (np.minimum(values[bounded], top_m) for values in (track.error_m, track.bound_m))
    counts, _, _ = np.histogram2d(errors_m, bounds_m, bins=(edges, edges))
    mesh = axes.pcolormesh(
        edges, edges, np.ma.masked_equal(counts.T, 0.0), cmap="viridis", norm=LogNorm(1.0, max(counts.max(), 2.0))
    )
    axes.figure.colorbar(mesh, ax=axes, label="epochs", fraction=0.046, pad=0.03)
    result = integrity_of(track, alert_limit_m)
    axes.set_title(
        f"{track.name}: {result.misleading} misleading, {result.unavailable_percent:.1f} % unavailable "
        f"of {track.epochs} epochs",
        fontsize=9,
    )
    beyond_m = 0.5 * (alert_limit_m + top_m)
    for x_m, y_m, words in (
        (0.4 * alert_limit_m, beyond_m, "unavailable"),
        (beyond_m, 0.5 * alert_limit_m, "hazardously\nmisleading"),
        (0.7 * alert_limit_m, 0.22 * alert_limit_m, "misleading"),
    ):
        axes.text(x_m, y_m, words, fontsize=8, color="#333333", ha="center", va="center", zorder=4)
    axes.set_xlabel("horizontal error [m]")
    axes.set_ylabel("horizontal bound [m]")
    axes.set_xlim(0.0, top_m)
    axes.set_ylim(0.0, top_m)
    axes.set_aspect("equal")


def draw_stanford(tracks: Sequence[BoundedErrors], alert_limit_m: float) -> Figure:
    """One panel per method, all to the same scale. Raises ValueError without a single bounded fix."""
    bounded = [one for one in tracks if np.isfinite(one.bound_m).any()]
    if not bounded:
        msg = "there is no fix with a bound to draw"
        raise ValueError(msg)
    errors_m = max(float(np.percentile(one.error_m, 99.5)) for one in bounded)
    bounds_m = max(float(np.nanpercentile(one.bound_m, 99.5)) for one in bounded)
    top_m = ROOM * max(SMALLEST * alert_limit_m, errors_m, min(bounds_m, LARGEST_BOUND * alert_limit_m))
    figure = Figure(figsize=((PANEL_IN + 1.2) * len(bounded), PANEL_IN), dpi=DOTS_PER_INCH, layout="constrained")
    for k, track in enumerate(bounded):
        _draw_panel(figure.add_subplot(1, len(bounded), k + 1), track, top_m, alert_limit_m)
    return figure


def save_stanford(path: Path, tracks: Sequence[BoundedErrors], alert_limit_m: float) -> None:
    """Write the diagram as PNG or SVG, by the extension of `path`. Raises ValueError, OSError."""
    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg"):
        msg = f"{path}: a plot is .png or .svg"
        raise ValueError(msg)
    part = path.with_name(f".{path.name}.part")
    with mpl.rc_context({"svg.hashsalt": "kirotei", "font.family": "DejaVu Sans"}):
        figure = draw_stanford(tracks, alert_limit_m)
        FigureCanvasAgg(figure)
        try:
            figure.savefig(part, format=kind, metadata={"Date": None} if kind == "svg" else {"Software": None})
            part.replace(path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
