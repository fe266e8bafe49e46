"""Odometry in pictures: speed and slips, error against bound, distances between marks (Iwata et al., figures 3, 4).

Other rooms' panels (curvature, margin: figure 5) can be put below. The same input gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from services.odometry_fusion.evaluation import (
    Marks,
    MotionTrack,
    MotionTruth,
    SlipSpan,
    Stretches,
    WheelWay,
    error_of,
    measured_stretches,
    spans_of,
)
from services.odometry_fusion.motion_log import Floats
from services.odometry_fusion.picture_plot import DOTS_PER_INCH, WIDTH_IN, head

COLOURS: Final = ("#1b6ca8", "#c0504d", "#3f8f4f", "#8a5aa8")
TRUE: Final = "#222222"
WHEEL: Final = "#8c8c8c"
SLIP: Final = "#f6deb6"
SPEED_IN, ERROR_IN, PAIR_IN = 2.6, 2.9, 3.3
AROUND_S: Final = 15.0
"""So much time before and after one slip is shown enlarged."""
FOOT: Final = 0.14
"""Share of the height below the curves where bars tell when a track told of a slip."""
LEAST_DRAWN_M: Final = 0.1
"""Smaller errors stand at the foot of the logarithmic scale."""
KMH: Final = 3.6
PERCENT: Final = 2.0


class Panel(NamedTuple):
    """A panel of another room, as wide as the picture."""

    height_in: float
    draw: Callable[[Axes], None]


def _wheel_speed(wheel: WheelWay) -> Floats:
    """Speed of the rim over about half a second, shape (n,)."""
    width = max(1, round(0.25 / max(1e-6, float(np.median(np.diff(wheel.t_s))))))
    before, after = np.maximum(np.arange(len(wheel.t_s)) - width, 0), np.arange(len(wheel.t_s)) + width
    after = np.minimum(after, len(wheel.t_s) - 1)
    speed_mps = (wheel.way_m[after] - wheel.way_m[before]) / (wheel.t_s[after] - wheel.t_s[before])
    return np.asarray(speed_mps, np.float64)


def _shown_slip(truth: MotionTruth, wheel: WheelWay | None, at_s: float | None) -> SlipSpan | None:
    """The slip nearest to a time; without one the slip that cost the wheel most. None without slips."""
    spans = spans_of(truth.slip != 0, truth.t_s)
    if not spans:
        return None
    if at_s is not None:
        return min(spans, key=lambda span: max(span.start_s - at_s, at_s - span.end_s))

    def cost(span: SlipSpan) -> float:
        if wheel is None:
            return span.end_s - span.start_s
        turned = np.diff(np.interp([span.start_s, span.end_s], wheel.t_s, wheel.way_m))[0]
        return float(abs(turned - np.diff(np.interp([span.start_s, span.end_s], truth.t_s, truth.distance_m))[0]))

    return max(spans, key=cost)


def _shade_slips(axes: Axes, truth: MotionTruth) -> None:
    for k, span in enumerate(spans_of(truth.slip != 0, truth.t_s)):
        words = None if k else "true slip"
        axes.axvspan(span.start_s, span.end_s, color=SLIP, linewidth=0, zorder=0, label=words)


def _tell_slips(axes: Axes, tracks: Sequence[MotionTrack]) -> None:
    """Bars at the foot, one row per track, while it told of a slip."""
    for k, (track, colour) in enumerate(zip(tracks, COLOURS, strict=False)):
        told = spans_of(track.slip, track.t_s)
        heights = [0.5 * FOOT * (k + 1) / len(tracks)] * len(told)
        axes.hlines(
            heights,
            [one.start_s for one in told],
            [one.end_s for one in told],
            color=colour,
            linewidth=min(4.0, 9.0 / len(tracks)),
            transform=axes.get_xaxis_transform(),
        )


def _draw_speed(
    axes: Axes,
    tracks: Sequence[MotionTrack],
    truth: MotionTruth,
    wheel: WheelWay | None,
    between_s: tuple[float, float],
) -> None:
    _shade_slips(axes, truth)
    drawn = [(truth.t_s, truth.speed_mps, TRUE, 1.6, "true")]
    if wheel is not None:
        drawn.insert(0, (wheel.t_s, _wheel_speed(wheel), WHEEL, 1.0, "wheel"))
    drawn += [
        (track.t_s, track.speed_mps, colour, 1.0, track.name) for track, colour in zip(tracks, COLOURS, strict=False)
    ]
    lowest, highest = np.inf, -np.inf
    for t_s, speed_mps, colour, width, name in drawn:
        axes.plot(t_s, KMH * speed_mps, color=colour, linewidth=width, label=name)
        inside = KMH * speed_mps[(t_s >= between_s[0]) & (t_s <= between_s[1])]
        if len(inside):
            lowest, highest = min(lowest, float(inside.min())), max(highest, float(inside.max()))
    reach = max(highest - lowest, 5.0)
    axes.set_ylim(lowest - FOOT * reach / (1.0 - FOOT) - 0.03 * reach, highest + 0.06 * reach)
    axes.set_xlim(*between_s)
    _tell_slips(axes, tracks)
    axes.set_ylabel("speed [km/h]")


def _draw_bounds(axes: Axes, tracks: Sequence[MotionTrack], truth: MotionTruth) -> None:
    _shade_slips(axes, truth)
    way_m = np.abs(np.interp(truth.t_s, tracks[0].t_s, tracks[0].distance_m - tracks[0].distance_m[0]))
    axes.plot(truth.t_s, 5.0 + 0.05 * way_m, color=TRUE, linewidth=0.9, linestyle=":", label="5 m + 5 % of the way")
    for track, colour in zip(tracks, COLOURS, strict=False):
        error_m = np.maximum(np.abs(error_of(track, truth)), LEAST_DRAWN_M)
        bound_m = np.maximum(track.bound_m, LEAST_DRAWN_M)
        if len(tracks) == 1:
            axes.fill_between(track.t_s, LEAST_DRAWN_M, bound_m, color=colour, alpha=0.08, linewidth=0)
        axes.plot(track.t_s, bound_m, color=colour, linewidth=1.2, linestyle="--")
        axes.plot(track.t_s, error_m, color=colour, linewidth=1.0, label=f"|error|, {track.name}")
    axes.plot([], [], color=TRUE, linewidth=1.2, linestyle="--", label="bounds")
    axes.set_yscale("log")
    axes.set_ylim(bottom=LEAST_DRAWN_M)
    axes.set_ylabel("error, bound [m]")
    axes.set_xlabel("time [s]")


def _draw_stretches(axes: Axes, found: Sequence[tuple[str, Stretches]]) -> None:
    """Errors of distances between marks; each is as wide as its stretch."""
    most = PERCENT
    for colour, one in found:
        if not len(one.true_m):
            continue
        rate = 100.0 * (one.measured_m - one.true_m) / one.true_m
        most = max(most, float(np.abs(rate).max()))
        first, last = one.begin_m / 1000.0, one.end_m / 1000.0
        axes.hlines(rate, first, last, color=colour, linewidth=0.8)
        middle = 0.5 * (first + last)
        axes.plot(middle[one.slipped], rate[one.slipped], "o", color=colour, markersize=5)
        axes.plot(middle[~one.slipped], rate[~one.slipped], "o", color=colour, markersize=5, fillstyle="none")
    if not any(len(one.true_m) for _, one in found):
        axes.text(0.5, 0.5, "no two of them were passed one after the other", ha="center", transform=axes.transAxes)
    for rate_percent in (-PERCENT, PERCENT):
        axes.axhline(rate_percent, color=TRUE, linewidth=0.9, linestyle=(0, (4, 3)))
    axes.set_ylim(-1.15 * most, 1.15 * most)
    axes.set_xlabel("way gone [km]")
    axes.set_ylabel("(measured − true) / true [%]")


def _dot(filled: Literal["full", "none"], words: str) -> Line2D:
    return Line2D([], [], color=TRUE, marker="o", markersize=5, linestyle="none", fillstyle=filled, label=words)


def draw_motion(
    tracks: Sequence[MotionTrack],
    truth: MotionTruth,
    wheel: WheelWay | None,
    marks: Marks,
    slip_at_s: float | None = None,
    panels: Sequence[Panel] = (),
) -> Figure:
    """All panels for tracks over one truth. Raises ValueError without a track, or with more than there are colours."""
    if not 0 < len(tracks) <= len(COLOURS):
        msg = f"a picture shows 1 to {len(COLOURS)} tracks, not {len(tracks)}"
        raise ValueError(msg)
    heights = (SPEED_IN, ERROR_IN, PAIR_IN, *(panel.height_in for panel in panels))
    figure = Figure(figsize=(WIDTH_IN, sum(heights)), dpi=DOTS_PER_INCH, layout="constrained")
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
    begin_s, end_s = float(truth.t_s[0]), float(truth.t_s[-1])
    whole = figure.add_subplot(grid[0, :])
    _draw_speed(whole, tracks, truth, wheel, (begin_s, end_s))
    head(whole, "Speed; bars at the foot: slip told")
    errors = figure.add_subplot(grid[1, :], sharex=whole)
    _draw_bounds(errors, tracks, truth)
    head(errors, "Error of the distance under its bound")
    slip = _shown_slip(truth, wheel, slip_at_s)
    if slip is not None:
        near = figure.add_subplot(grid[2, 0])
        _draw_speed(near, tracks, truth, wheel, (slip.start_s - AROUND_S, slip.end_s + AROUND_S))
        near.set_xlabel("time [s]")
        head(near, "One slip; colours as above", ())
    between = figure.add_subplot(grid[2, 1 if slip else slice(None)])
    ways = [] if wheel is None else [(WHEEL, wheel.t_s, wheel.way_m)]
    ways += [(colour, one.t_s, one.distance_m) for one, colour in zip(tracks, COLOURS, strict=False)]
    _draw_stretches(between, [(colour, measured_stretches(t_s, way_m, truth, marks)) for colour, t_s, way_m in ways])
    head(between, f"Distance between {marks.kind}", [_dot("full", "slip between"), _dot("none", "no slip")])
    for k, panel in enumerate(panels):
        panel.draw(figure.add_subplot(grid[3 + k, :]))
    return figure
