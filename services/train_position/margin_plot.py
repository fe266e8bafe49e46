"""The margin along the way (the lower part of Iwata et al., figure 5), and errors against their bounds.

The same input gives the same bytes.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from services.odometry_fusion.picture_plot import DOTS_PER_INCH, WIDTH_IN, caption, head
from services.train_position.evaluation import Floats, Passes, Positions, Truth, judge

PAPER_SHARE: Final = 0.02
PAPER_SLIP_M: Final = 20.0
"""The paper's margin: 2 % of the way since the last reference, and 20 m for one slip."""
CAB_STEP_M: Final = 30.0
"""The front end moves by more between two positions when the other cab leads; that is no way gone."""
FOOT: Final = 0.06
"""Share of the height at the foot in which the status is told."""
MARGIN, ERROR, PAPER, SLIP = "#1f5fa8", "#c0392b", "#6f6f6f", "#f6deb6"
REFERENCES: Final = {"landmark": "#1a7f37", "balise": "#7b3fa0"}
STATUSES: Final = {"degraded": "#e69f00", "lost": "#c62828"}
"""Coloured where they hold; everything else is valid."""


def way_of(axis_m: Floats) -> Floats:
    """Way gone [km] from one place to the next, shape (n,); NaN stands still."""
    kept = axis_m[np.isfinite(axis_m)]
    filled = np.interp(np.arange(len(axis_m)), np.flatnonzero(np.isfinite(axis_m)), kept) if len(kept) else axis_m * 0.0
    steps_m = np.abs(np.diff(filled, prepend=filled[0]))
    return np.asarray(np.cumsum(np.where(steps_m < CAB_STEP_M, steps_m, 0.0)) / 1000.0, np.float64)


def draw_saw(
    axes: Axes, positions: Positions, way_km: Floats, error_m: Floats | None = None, passes: Passes | None = None
) -> None:
    """Margin against the way gone with its resets, the paper's margins, slips, status, and the error where known."""
    margin_m = positions.margin_m
    _fill(axes, way_km, positions.slip, (0.0, 1.0), SLIP, "slip told")
    for status, colour in STATUSES.items():
        there = np.array([one == status for one in positions.status])
        _fill(axes, way_km, there, (0.0, FOOT), colour, status)
    axes.plot(way_km, _paper_margin(way_km), color=PAPER, linestyle="--", linewidth=1.1, label="20 m + 2 %")
    if passes is not None and len(passes.t_s):
        met_km = np.interp(passes.t_s, positions.t_s, way_km)
        since_last_km = way_km - np.array([met_km[met_km <= km].max(initial=0.0) for km in way_km])
        words = "since the last reference"
        axes.plot(way_km, _paper_margin(since_last_km), color=PAPER, linestyle=":", linewidth=1.1, label=words)
        _draw_references(axes, met_km, passes)
    axes.plot(way_km, margin_m, color=MARGIN, linewidth=1.4, label="margin")
    if error_m is not None:
        axes.plot(way_km, np.abs(error_m), color=ERROR, linewidth=1.1, label="|error|")
    axes.set_ylim(0.0, 1.2 * max(10.0, float(np.nanmax(margin_m, initial=0.0))))
    axes.set_xlim(0.0, max(float(way_km[-1]), 0.1))
    axes.set_xlabel("way gone [km]")
    axes.set_ylabel("margin [m]")


def _paper_margin(way_km: Floats) -> Floats:
    return PAPER_SHARE * 1000.0 * way_km + PAPER_SLIP_M


def _fill(
    axes: Axes, way_km: Floats, where: NDArray[np.bool_], between: tuple[float, float], colour: str, words: str
) -> None:
    """Shade the way where something holds, over a part of the height; nothing, nor a name, where it never does."""
    if where.any():
        whole = axes.get_xaxis_transform()
        axes.fill_between(way_km, *between, where=where, color=colour, linewidth=0, transform=whole, label=words)


def _draw_references(axes: Axes, met_km: Floats, passes: Passes) -> None:
    kinds = passes.kinds or ("landmark",) * len(met_km)
    for kind, colour in REFERENCES.items():
        places = [km for km, one in zip(met_km.tolist(), kinds, strict=True) if one == kind]
        if not places:
            continue
        axes.vlines(places, 0.0, 1.0, color=colour, linewidth=0.5, alpha=0.5, transform=axes.get_xaxis_transform())
        axes.plot(
            places,
            [0.97] * len(places),
            "v",
            color=colour,
            markersize=6,
            linestyle="none",
            transform=axes.get_xaxis_transform(),
            label=kind,
        )


def draw_margin(positions: Positions, truth: Truth, passes: Passes | None = None) -> Figure:
    """Margin and error against the way gone, and margin against error. Raises ValueError without common times."""
    found = judge(positions, truth)
    error_m = positions.axis_m - truth.at(positions.t_s)
    way_km = way_of(truth.at(positions.t_s))
    known = np.isfinite(error_m)
    figure = Figure(figsize=(WIDTH_IN, 7.2), dpi=DOTS_PER_INCH, layout="constrained")
    caption(
        figure,
        f"{found.name}: {found.within_percent:.2f} % of {found.compared} positions within their bounds; margin's "
        f"maxima between resets: median {found.median_of_maxima_m:.0f} m, largest {found.largest_margin_m:.0f} m",
    )
    grid = figure.add_gridspec(2, 3, height_ratios=(1.15, 1.0))
    saw = figure.add_subplot(grid[0, :])
    draw_saw(saw, positions, way_km, error_m, passes)
    head(saw, "Margin")
    signed = figure.add_subplot(grid[1, :2], sharex=saw)
    signed.fill_between(way_km, -positions.behind_m, positions.ahead_m, color="#cfe0f3", linewidth=0, label="bounds")
    signed.plot(way_km, -error_m * positions.sign, color=ERROR, linewidth=1.0, label="truth − estimate")
    signed.set_xlabel("way gone [km]")
    signed.set_ylabel("ahead of the estimate [m]")
    head(signed, "Truth within the bounds")
    _draw_against(figure.add_subplot(grid[1, 2]), np.abs(error_m[known]), positions.margin_m[known])
    return figure


def _draw_against(axes: Axes, error_m: Floats, margin_m: Floats) -> None:
    """Each position by its error and its margin: whatever lies below the diagonal has lied."""
    right_m = 1.15 * max(float(error_m.max()), 1.0)
    top_m = 1.1 * max(float(margin_m.max()), 1.0)
    corner_m = min(right_m, top_m)
    axes.fill_between(
        [0.0, corner_m, right_m],
        0.0,
        [0.0, corner_m, corner_m],
        color="#f7d6d2",
        linewidth=0,
        label="error above margin",
    )
    axes.scatter(error_m, margin_m, s=3, color=MARGIN, alpha=0.35, linewidths=0, rasterized=True)
    axes.set_xlim(0.0, right_m)
    axes.set_ylim(0.0, top_m)
    axes.set_xlabel("|error| [m]")
    axes.set_ylabel("margin [m]")
    head(axes, "")
