"""Curvature of a run against the database, along the line (the upper part of Iwata et al., figure 5).

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

from schemas.line import Landmark
from services.landmark_matching.curve_shape import CurveShape, direction_sign, mean_curvature, shape_of_landmark
from services.landmark_matching.matcher import Match
from services.landmark_matching.run_matching import RunMatches, TracePoint

DOTS_PER_INCH: Final = 150
ROW_KM: Final = 7.0
"""Length of line per panel."""
MOST_ROWS: Final = 12
PER_KM: Final = 1000.0
MEASURED, DATABASE, ACCEPTED, REFUSED = "#1f4e9c", "#9a9a9a", "#1a7f37", "#c62828"


def draw_curvature(runs: RunMatches, landmarks: Sequence[Landmark], title: str) -> Figure:
    """Panels of at most ROW_KM each; raises ValueError where the run shows no curvature."""
    trace = [point for point in runs.trace if np.isfinite(point.curvature_per_m)]
    if not trace:
        msg = "there is no curvature to draw: the run is too slow, or has no inertial sensor"
        raise ValueError(msg)
    places = np.array([point.axis_m for point in trace]) / PER_KM
    first, last = float(places.min()), float(places.max())
    count = min(MOST_ROWS, max(1, round((last - first) / ROW_KM)))
    edges = np.linspace(first - 0.05, last + 0.05, count + 1)
    figure = Figure(figsize=(11.0, 2.3 * count + 0.7), dpi=DOTS_PER_INCH, layout="constrained")
    top = 1.45 * max(
        [float(np.percentile(np.abs([point.curvature_per_m for point in trace]), 99.5)), 1e-3]
        + [1.0 / landmark.radius_m for landmark in landmarks]
    )
    for k in range(count):
        axes = figure.add_subplot(count, 1, k + 1)
        _panel(axes, trace, runs.matches, landmarks, (float(edges[k]), float(edges[k + 1])))
        axes.set_ylim(-PER_KM * top, PER_KM * top)
        if k == 0:
            axes.set_title(title, fontsize=9)
            axes.legend(loc="upper right", fontsize=7, ncols=4, framealpha=0.9)
    axes.set_xlabel("place along the axis [km]")
    return figure


def _panel(
    axes: Axes,
    trace: Sequence[TracePoint],
    matches: Sequence[Match],
    landmarks: Sequence[Landmark],
    between_km: tuple[float, float],
) -> None:
    inside = [point for point in trace if between_km[0] <= point.axis_m / PER_KM <= between_km[1]]
    ways = {(point.branch, point.direction) for point in trace}
    drawn = [one for one in landmarks if (one.branch, one.direction) in ways]
    for number, landmark in enumerate(drawn):
        _database_curve(axes, landmark, named=number == 0)
    axes.plot(*_line_of(inside), color=MEASURED, linewidth=0.9, label="measured, mean over 2 s", zorder=3)
    for accepted, color, marker in ((True, ACCEPTED, "v"), (False, REFUSED, "x")):
        chosen = [one for one in matches if one.accepted is accepted]
        places = [one.axis_m / PER_KM for one in chosen]
        heights = [_height(one.landmark, sign=1.0) * one.landmark.lower_share for one in chosen]
        words = "accepted, exit crossing" if accepted else "refused"
        axes.plot(places, heights, marker, color=color, markersize=5, linestyle="none", label=words, zorder=4)
    axes.axhline(0.0, color="#555555", linewidth=0.5)
    axes.set_xlim(*between_km)
    axes.set_ylabel("curvature [1/km]", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.grid(visible=True, linewidth=0.3, color="#dddddd")


def _height(landmark: Landmark, sign: float) -> float:
    """Curvature of the arc [1/km], left positive as the train sees it."""
    return sign * (1.0 if landmark.hand == "left" else -1.0) * PER_KM / landmark.radius_m


def _database_curve(axes: Axes, landmark: Landmark, *, named: bool) -> None:
    """The database's curve with its lower and upper limit between the crossings."""
    sign = direction_sign(landmark.direction)
    shape: CurveShape = shape_of_landmark(landmark)
    u = np.array([shape.start_m, shape.arc_start_m, shape.arc_end_m, shape.end_m])
    x = sign * u / PER_KM
    y = PER_KM * mean_curvature(shape, u, 0.1)
    axes.fill(x, y, color=DATABASE, alpha=0.35, linewidth=0.0, label="database" if named else None, zorder=1)
    ends = [landmark.entry_lower_limit_m / PER_KM, landmark.exit_lower_limit_m / PER_KM]
    for share in (landmark.lower_share, landmark.upper_share):
        level = _height(landmark, 1.0) * share
        axes.plot(ends, [level, level], color="#666666", linewidth=0.7, linestyle=(0, (3, 2)), zorder=2)
    middle = 0.5 * (ends[0] + ends[1])
    axes.text(
        middle, _height(landmark, 1.0) * 1.3, landmark.id, fontsize=5, ha="center", va="center", clip_on=True, zorder=4
    )


def _line_of(points: Sequence[TracePoint]) -> tuple[list[float], list[float]]:
    """Places and curvatures with a break wherever points are more than two seconds apart."""
    x: list[float] = []
    y: list[float] = []
    before = None
    for point in points:
        if before is not None and point.t_s - before > 2.0:  # noqa: PLR2004 - seconds, a gap
            x.append(float("nan"))
            y.append(float("nan"))
        x.append(point.axis_m / PER_KM)
        y.append(PER_KM * point.curvature_per_m)
        before = point.t_s
    return x, y


def save_curvature(path: Path, runs: RunMatches, landmarks: Sequence[Landmark], title: str) -> None:
    """Write the picture as PNG or SVG, by the extension of `path`. Raises ValueError, OSError."""
    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg"):
        msg = f"{path}: a plot is .png or .svg"
        raise ValueError(msg)
    part = path.with_name(f".{path.name}.part")
    with mpl.rc_context({"svg.hashsalt": "kirotei", "font.family": "DejaVu Sans"}):
        figure = draw_curvature(runs, landmarks, title)
        FigureCanvasAgg(figure)
        try:
            figure.savefig(part, format=kind, metadata={"Date": None} if kind == "svg" else {"Software": None})
            part.replace(path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
