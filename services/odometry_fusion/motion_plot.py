"""Odometry in pictures: speed and slips, error against bound, distances between marks (Iwata et al., Figures 3, 4).

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
from matplotlib.figure import Figure

from services.odometry_fusion.evaluation import (
    MotionTrack,
    MotionTruth,
    WheelWay,
    error_of,
    mark_errors,
    spans_of,
)
from services.odometry_fusion.motion_log import Floats

COLOURS: Final = ("#1b6ca8", "#c0504d", "#3f8f4f", "#8a5aa8")
TRUE: Final = "#333333"
SLIP: Final = "#f3d9b1"
DOTS_PER_INCH: Final = 130
WIDTH_IN: Final = 13.0
AROUND_S: Final = 25.0
"""So much time before and after the costliest slip is shown beside the whole run."""
KMH: Final = 3.6
PERCENT: Final = 2.0


def _wheel_speed(wheel: WheelWay) -> Floats:
    """Speed of the rim over about half a second, shape (n,)."""
    width = max(1, round(0.25 / max(1e-6, float(np.median(np.diff(wheel.t_s))))))
    before, after = np.maximum(np.arange(len(wheel.t_s)) - width, 0), np.arange(len(wheel.t_s)) + width
    after = np.minimum(after, len(wheel.t_s) - 1)
    speed_mps = (wheel.way_m[after] - wheel.way_m[before]) / (wheel.t_s[after] - wheel.t_s[before])
    return np.asarray(speed_mps, np.float64)


def _costliest(truth: MotionTruth, wheel: WheelWay | None) -> tuple[float, float] | None:
    """Stretch around the slip that cost the wheel most; None without slips."""
    spans = spans_of(truth.slip != 0, truth.t_s)
    if not spans:
        return None

    def cost(start_s: float, end_s: float) -> float:
        if wheel is None:
            return end_s - start_s
        turned = np.diff(np.interp([start_s, end_s], wheel.t_s, wheel.way_m))[0]
        return float(abs(turned - np.diff(np.interp([start_s, end_s], truth.t_s, truth.distance_m))[0]))

    worst = max(spans, key=lambda span: cost(span.start_s, span.end_s))
    return worst.start_s - AROUND_S, worst.end_s + AROUND_S


def _draw_speed(axes: Axes, tracks: Sequence[MotionTrack], truth: MotionTruth, wheel: WheelWay | None) -> None:
    for span in spans_of(truth.slip != 0, truth.t_s):
        axes.axvspan(span.start_s, span.end_s, color=SLIP, linewidth=0, zorder=0)
    if wheel is not None:
        axes.plot(wheel.t_s, KMH * _wheel_speed(wheel), color="#999999", linewidth=0.8, label="wheel")
    axes.plot(truth.t_s, KMH * truth.speed_mps, color=TRUE, linewidth=1.2, label="true")
    for track, colour in zip(tracks, COLOURS, strict=False):
        axes.plot(track.t_s, KMH * track.speed_mps, color=colour, linewidth=0.9, label=track.name)
        told = spans_of(track.slip, track.t_s)
        height = -2.0 - 2.0 * tracks.index(track)
        axes.hlines([height] * len(told), [s.start_s for s in told], [s.end_s for s in told], color=colour, linewidth=3)
    axes.set_ylabel("speed [km/h]")
    axes.grid(visible=True, color="#e4e4e4", linewidth=0.6)


def _draw_bounds(axes: Axes, tracks: Sequence[MotionTrack], truth: MotionTruth) -> None:
    for span in spans_of(truth.slip != 0, truth.t_s):
        axes.axvspan(span.start_s, span.end_s, color=SLIP, linewidth=0, zorder=0)
    for track, colour in zip(tracks, COLOURS, strict=False):
        axes.plot(track.t_s, error_of(track, truth), color=colour, linewidth=1.0, label=f"error, {track.name}")
        axes.plot(track.t_s, track.bound_m, color=colour, linewidth=0.8, linestyle=(0, (4, 2)))
        axes.plot(track.t_s, -track.bound_m, color=colour, linewidth=0.8, linestyle=(0, (4, 2)))
    distance_m = np.interp(truth.t_s, tracks[0].t_s, tracks[0].distance_m - tracks[0].distance_m[0])
    for sign in (1.0, -1.0):
        label = "5 m + 5 %" if sign > 0.0 else None
        limit_m = sign * (5.0 + 0.05 * distance_m)
        axes.plot(truth.t_s, limit_m, color="#888888", linewidth=0.8, linestyle=":", label=label)
    axes.set_ylabel("error, bound (dashed) [m]")
    axes.set_xlabel("time [s]")
    axes.legend(fontsize=8, loc="upper left")
    axes.grid(visible=True, color="#e4e4e4", linewidth=0.6)


def _draw_marks(axes: Axes, tracks: Sequence[MotionTrack], truth: MotionTruth, spacing_m: float) -> None:
    for track, colour in zip(tracks, COLOURS, strict=False):
        true_m, own_m, slipped = mark_errors(track, truth, spacing_m)
        rate = 100.0 * (own_m - true_m) / true_m
        places = np.arange(1, len(rate) + 1)
        axes.plot(places[slipped], rate[slipped], "o", color=colour, label=f"{track.name}, with a slip")
        axes.plot(places[~slipped], rate[~slipped], "o", color=colour, fillstyle="none", label=f"{track.name}, without")
    for rate_percent in (-PERCENT, PERCENT):
        axes.axhline(rate_percent, color=TRUE, linewidth=0.8, linestyle=(0, (4, 3)))
    axes.set_xlabel(f"stretches of {spacing_m:g} m between marks, in order")
    axes.set_ylabel("(measured - true) / true [%]")
    axes.legend(fontsize=8)
    axes.grid(visible=True, color="#e4e4e4", linewidth=0.6)


def draw_motion(tracks: Sequence[MotionTrack], truth: MotionTruth, wheel: WheelWay | None, spacing_m: float) -> Figure:
    """All panels for tracks over one truth. Raises ValueError without a track."""
    if not tracks:
        msg = "there is nothing to draw"
        raise ValueError(msg)
    figure = Figure(figsize=(WIDTH_IN, 10.5), dpi=DOTS_PER_INCH, layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(1.0, 1.0, 0.9))
    whole = figure.add_subplot(grid[0, :])
    _draw_speed(whole, tracks, truth, wheel)
    whole.set_title("speed; true slips shaded, slips as told below zero", fontsize=10)
    whole.legend(fontsize=8, loc="upper right", ncols=2 + len(tracks))
    _draw_bounds(figure.add_subplot(grid[1, :], sharex=whole), tracks, truth)
    near = figure.add_subplot(grid[2, 0])
    _draw_speed(near, tracks, truth, wheel)
    near.set_xlabel("time [s]")
    stretch = _costliest(truth, wheel)
    near.set_title("the costliest slip" if stretch else "the whole run", fontsize=10)
    if stretch:
        near.set_xlim(*stretch)
    marks = figure.add_subplot(grid[2, 1])
    _draw_marks(marks, tracks, truth, spacing_m)
    marks.set_title("distances between marks", fontsize=10)
    return figure


def save_motion(
    path: Path, tracks: Sequence[MotionTrack], truth: MotionTruth, wheel: WheelWay | None, spacing_m: float
) -> None:
    """Write the picture as PNG or SVG, by the extension of `path`. Raises ValueError, OSError."""
    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg"):
        msg = f"{path}: a plot is .png or .svg"
        raise ValueError(msg)
    part = path.with_name(f".{path.name}.part")
    with mpl.rc_context({"svg.hashsalt": "kirotei", "font.family": "DejaVu Sans"}):
        figure = draw_motion(tracks, truth, wheel, spacing_m)
        FigureCanvasAgg(figure)
        try:
            figure.savefig(part, format=kind, metadata={"Date": None} if kind == "svg" else {"Software": None})
            part.replace(path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
