"""Curvature of a run against the database, along the line (the upper part of Iwata et al., figure 5).

The same input gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from schemas.line import Curve, Direction, Landmark
from services.landmark_matching.curve_shape import (
    CurveShape,
    direction_sign,
    mean_curvature,
    shape_of_curve,
    shape_of_landmark,
)
from services.landmark_matching.matcher import Match
from services.landmark_matching.run_matching import RunMatches, TracePoint
from services.odometry_fusion.picture_plot import DOTS_PER_INCH, WIDTH_IN, caption, head

ROW_IN: Final = 2.0
ROW_KM: Final = 7.0
"""Length of line per panel."""
LONG_KM: Final = 9.0
"""Names are smaller where a panel shows more."""
MOST_ROWS: Final = 12
PER_KM: Final = 1000.0
LARGEST_GAP_S: Final = 2.0
LARGEST_GAP_M: Final = 200.0
"""Points further apart are not joined, nor those of two directions."""
OFF_M: Final = 30.0
"""A curve of the line that no landmark stands within this of, at its begin or end, is no landmark."""
MEASURED, DATABASE, ACCEPTED, REFUSED = "#1f4e9c", "#b9b9b9", "#1a7f37", "#c62828"

Curves = Mapping[str, Sequence[Curve]]
"""Of the line, by branch."""


def drawn_between(runs: RunMatches, row_km: float) -> list[tuple[float, float]]:
    """Stretches of line [km] that panels show, one per panel. Raises ValueError where the run shows no curvature."""
    places = [point.axis_m / PER_KM for point in runs.trace if np.isfinite(point.curvature_per_m)]
    if not places:
        msg = "there is no curvature to draw: the run is too slow, or has no inertial sensor"
        raise ValueError(msg)
    first, last = min(places), max(places)
    count = min(MOST_ROWS, max(1, round((last - first) / row_km)))
    edges = np.linspace(first - 0.05, last + 0.05, count + 1).tolist()
    return list(pairwise(edges))


def draw_curvature(runs: RunMatches, landmarks: Sequence[Landmark], curves: Curves, title: str) -> Figure:
    """Panels of at most ROW_KM each and one of corrections. Raises ValueError where the run shows no curvature."""
    rows = drawn_between(runs, ROW_KM)
    figure = Figure(figsize=(WIDTH_IN, ROW_IN * (len(rows) + 1)), dpi=DOTS_PER_INCH, layout="constrained")
    caption(figure, title)
    for k, between_km in enumerate(rows):
        axes = figure.add_subplot(len(rows) + 1, 1, k + 1)
        draw_stretch(axes, runs, landmarks, curves, between_km)
        if k == 0:
            head(axes, "Curvature")
    last = figure.add_subplot(len(rows) + 1, 1, len(rows) + 1)
    _draw_corrections(last, runs.matches)
    last.set_xlim(rows[0][0], rows[-1][1])
    last.set_xlabel("place along the axis [km]")
    head(last, "Corrections with their bounds")
    return figure


def draw_stretch(
    axes: Axes, runs: RunMatches, landmarks: Sequence[Landmark], curves: Curves, between_km: tuple[float, float]
) -> None:
    """Measured curvature over the database's curves, with what was accepted and refused, between two places."""
    trace = [point for point in runs.trace if between_km[0] <= point.axis_m / PER_KM <= between_km[1]]
    ways = {(point.branch, point.direction) for point in runs.trace}
    drawn = [one for one in landmarks if (one.branch, one.direction) in ways]
    size = 7.0 if between_km[1] - between_km[0] <= LONG_KM else 6.0
    for number, landmark in enumerate(drawn):
        _draw_landmark(axes, landmark, size, named=number == 0)
    _draw_others(axes, drawn, curves, ways)
    axes.plot(*_joined(trace), color=MEASURED, linewidth=1.2, label="measured, mean over 2 s", zorder=3)
    _draw_verdicts(axes, runs.matches)
    tallest = max([1e-3, *(1.0 / one.radius_m for one in landmarks)])
    axes.set_ylim(-1.55 * PER_KM * tallest, 1.55 * PER_KM * tallest)
    axes.axhline(0.0, color="#555555", linewidth=0.5)
    axes.set_xlim(*between_km)
    axes.set_ylabel("curvature [1/km]\nleft positive", fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(visible=True, linewidth=0.4, color="#dddddd")


def _height(landmark: Landmark) -> float:
    """Curvature of the arc [1/km], left positive as the train sees it."""
    return (1.0 if landmark.hand == "left" else -1.0) * PER_KM / landmark.radius_m


def _outline(shape: CurveShape, direction: Direction) -> tuple[np.ndarray, np.ndarray]:
    """Places [km] and curvature [1/km] of a curve's corners."""
    u = np.array([shape.start_m, shape.arc_start_m, shape.arc_end_m, shape.end_m])
    return direction_sign(direction) * u / PER_KM, PER_KM * mean_curvature(shape, u, 0.1)


def _draw_landmark(axes: Axes, landmark: Landmark, size: float, *, named: bool) -> None:
    """The database's curve with its lower and upper limit between the crossings."""
    x, y = _outline(shape_of_landmark(landmark), landmark.direction)
    axes.fill(x, y, color=DATABASE, alpha=0.5, linewidth=0.0, label="landmark" if named else None, zorder=1)
    ends = [landmark.entry_lower_limit_m / PER_KM, landmark.exit_lower_limit_m / PER_KM]
    for k, share in enumerate((landmark.lower_share, landmark.upper_share)):
        level = _height(landmark) * share
        words = "its lower and upper limit" if named and k == 0 else None
        axes.plot(ends, [level, level], color="#444444", linewidth=0.8, linestyle=(0, (3, 2)), zorder=2, label=words)
    axes.text(
        0.5 * (ends[0] + ends[1]),
        _height(landmark) * 1.2 + np.sign(_height(landmark)) * 0.5,
        landmark.id,
        fontsize=size,
        ha="center",
        va="center",
        clip_on=True,
        zorder=4,
    )


def _draw_others(axes: Axes, landmarks: Sequence[Landmark], curves: Curves, ways: set[tuple[str, Direction]]) -> None:
    """Curves of the line that are no landmarks, as outlines."""
    ends = {}
    for one in landmarks:
        shape, sign = shape_of_landmark(one), direction_sign(one.direction)
        ends[one.id] = sorted((sign * shape.start_m, sign * shape.end_m))
    words: str | None = "curve that is no landmark"
    for branch, direction in sorted(ways):
        for curve in curves.get(branch, ()):
            if any(abs(curve.start_axis_m - a) < OFF_M or abs(curve.end_axis_m - b) < OFF_M for a, b in ends.values()):
                continue
            x, y = _outline(shape_of_curve(curve, direction), direction)
            axes.fill(x, y, facecolor="none", edgecolor="#999999", hatch="////", linewidth=0.6, label=words, zorder=1)
            words = None


def _draw_verdicts(axes: Axes, matches: Sequence[Match]) -> None:
    accepted = [one for one in matches if one.accepted]
    places = [one.axis_m / PER_KM for one in accepted]
    heights = [_height(one.landmark) * one.landmark.lower_share for one in accepted]
    axes.plot(places, heights, "v", color=ACCEPTED, markersize=6, linestyle="none", label="exit crossing", zorder=4)
    words: str | None = "refused"
    for one in matches:
        if one.accepted:
            continue
        x = one.landmark.exit_lower_limit_m / PER_KM
        y = _height(one.landmark) * one.landmark.lower_share
        axes.plot(
            [x], [y], "x", color=REFUSED, markersize=8, markeredgewidth=2, linestyle="none", label=words, zorder=4
        )
        axes.annotate(
            one.kind,
            (x, y),
            (8, 0),
            textcoords="offset points",
            fontsize=7,
            color=REFUSED,
            va="center",
            annotation_clip=True,
        )
        words = None


def _draw_corrections(axes: Axes, matches: Sequence[Match]) -> None:
    accepted = [one for one in matches if one.accepted]
    axes.errorbar(
        [one.axis_m / PER_KM for one in accepted],
        [one.correction_m for one in accepted],
        [one.bound_m for one in accepted],
        fmt="v",
        color=ACCEPTED,
        markersize=5,
        elinewidth=1.0,
        capsize=3,
        label="accepted: correction ± bound",
    )
    refused = [one.landmark.exit_lower_limit_m / PER_KM for one in matches if not one.accepted]
    if refused:
        zero = [0.0] * len(refused)
        axes.plot(refused, zero, "x", color=REFUSED, markersize=8, markeredgewidth=2, linestyle="none", label="refused")
    axes.axhline(0.0, color="#555555", linewidth=0.5)
    axes.set_ylabel("along the axis [m]", fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(visible=True, linewidth=0.4, color="#dddddd")


def _joined(points: Sequence[TracePoint]) -> tuple[list[float], list[float]]:
    """Places and curvatures with a break wherever one point does not follow from the one before."""
    x: list[float] = []
    y: list[float] = []
    before = None
    for point in points:
        if before is not None and not _follows(before, point):
            x.append(float("nan"))
            y.append(float("nan"))
        x.append(point.axis_m / PER_KM)
        y.append(PER_KM * point.curvature_per_m)
        before = point
    return x, y


def _follows(before: TracePoint, point: TracePoint) -> bool:
    near = abs(point.axis_m - before.axis_m) <= LARGEST_GAP_M and point.t_s - before.t_s <= LARGEST_GAP_S
    return near and point.direction == before.direction
