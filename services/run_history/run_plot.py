"""Figures 2 to 7 of Maki et al. for one section: speeds over the way, running times, energy, margin.

Functions draw into a new figure; text stays text. The same report gives the same figure.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from services.run_history.optimum import Optimum
from services.run_history.report_words import Language, said
from services.run_history.run_report import SectionReport
from services.run_history.run_statistics import histogram
from services.run_history.section_driving import Driving, Way, same_leg
from services.run_history.speed_trace import KMH, SpeedTrace

GREY: Final = "#b5b5b5"
BEST: Final = "#1f5fa8"
OPTIMUM: Final = "#2e8b57"
LIMIT: Final = "#c0392b"
THIS: Final = "#111111"
PATTERNS: Final = {
    "on_time_saving": "#e67e22",
    "on_time_wasteful": "#d4b106",
    "slower_saving": "#1f5fa8",
    "faster_saving": "#2e8b57",
    "fastest": "#17a2b8",
}
WIDE: Final = (10.5, 5.6)


def overlay(section: SectionReport, language: Language) -> Figure:
    """All runs in grey, the representative one, the optimum, limits, stations and gradients (Figures 2, 3, 7)."""
    driving = section.driving
    figure, axes = _over_the_way(driving, language)
    if driving is None:
        return figure
    for number, trace in enumerate(driving.traces):
        _line(axes, trace, GREY, 0.7, said("population", language) if number == 0 else "")
    if driving.optimum is not None:
        _optimum(axes, driving.optimum, driving.way, language)
    if driving.best is not None:
        _line(axes, driving.traces[driving.best], BEST, 2.0, said("best", language))
    _finish(axes)
    return figure


def patterns(section: SectionReport, language: Language) -> Figure:
    """The population in grey with the article's five patterns in colour (Figure 3)."""
    driving = section.driving
    figure, axes = _over_the_way(driving, language)
    if driving is None:
        return figure
    for trace in driving.traces:
        _line(axes, trace, GREY, 0.7, "")
    for pattern in section.patterns:
        for trace in driving.traces:
            row = pattern.row
            if row is not None and same_leg(trace, row):
                label = f"{said(pattern.name, language)} ({row.running_time_s:.0f} s, {row.energy_kwh:.1f} kWh)"
                _line(axes, trace, PATTERNS[pattern.name], 1.6, label)
    _finish(axes)
    return figure


def crew_sheet(section: SectionReport, run: int, language: Language) -> Figure:
    """One run over the representative one and the optimum."""
    driving = section.driving
    figure, axes = _over_the_way(driving, language)
    if driving is None:
        return figure
    if driving.optimum is not None:
        _optimum(axes, driving.optimum, driving.way, language)
    if driving.best is not None:
        _line(axes, driving.traces[driving.best], BEST, 1.5, said("best", language))
    _line(axes, driving.traces[run], THIS, 1.8, said("this_run", language))
    for dip in driving.again[run]:
        axes.plot(dip.at_m / 1000.0, KMH * dip.low_mps, marker="v", color=LIMIT, markersize=8)
    _finish(axes)
    return figure


def _over_the_way(driving: Driving | None, language: Language) -> tuple[Figure, Axes]:
    """Axes of speed with limits and stations above axes of the gradient."""
    figure = Figure(figsize=WIDE, layout="constrained")
    axes, below = figure.subplots(2, 1, sharex=True, height_ratios=(6, 1))
    axes.set_ylabel(said("speed", language))
    below.set_ylabel(said("gradient", language))
    below.set_xlabel(said("distance", language))
    if driving is not None:
        way = driving.way
        km = way.grid_m / 1000.0
        if np.isfinite(way.limit_mps).any():
            limit = np.where(np.isfinite(way.limit_mps), KMH * way.limit_mps, np.nan)
            axes.step(km, limit, where="post", color=LIMIT, linewidth=1.0, label=said("limit", language))
        below.fill_between(km, way.gradient_permille, step="post", color="#9c8467", linewidth=0)
        below.axhline(0.0, color="#555555", linewidth=0.5)
        below.locator_params(axis="y", nbins=3)
        top = axes.secondary_xaxis("top")
        top.set_xticks([place / 1000.0 for _, place in way.stations], [name for name, _ in way.stations], fontsize=8)
        for _, place in way.stations:
            axes.axvline(place / 1000.0, color="#777777", linewidth=0.6, linestyle=(0, (2, 3)))
        edges = [edge / 1000.0 for trace in driving.traces for edge in (float(trace.way_m[0]), float(trace.way_m[-1]))]
        axes.set_xlim(min(0.0, *edges) - 0.01 * float(km[-1]), max(float(km[-1]), *edges) + 0.01 * float(km[-1]))
    axes.grid(visible=True, color="#e4e4e4", linewidth=0.5)
    return figure, axes


def _line(axes: Axes, trace: SpeedTrace, colour: str, width: float, label: str) -> None:
    axes.plot(
        trace.way_m / 1000.0,
        KMH * trace.speed_mps,
        color=colour,
        linewidth=width,
        label=label or "_",
        zorder=1 if colour == GREY else 4,
    )


def _optimum(axes: Axes, found: Optimum, way: Way, language: Language) -> None:
    place = way.sign * (found.axis_m - way.start_axis_m) / 1000.0
    axes.plot(place, KMH * found.speed_mps, color=OPTIMUM, linewidth=1.5, label=said("optimum", language), zorder=3)


def _finish(axes: Axes) -> None:
    axes.set_ylim(bottom=0.0)
    axes.margins(y=0.12)
    # Below the pattern of speeds there is room in the middle of the way; at its ends there is none.
    axes.legend(loc="lower center", fontsize=8, ncols=2, framealpha=0.9)


def distributions(section: SectionReport, language: Language) -> Figure:
    """Running times, time against energy with the band of the margin, and mean against least (Figures 4, 5, 6)."""
    figure = Figure(figsize=(10.5, 3.9), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.0, 1.3, 0.8))
    group, margin = section.group, section.margin
    bars = histogram(group.times_s)
    share = 100.0 * bars.counts / max(1, bars.counts.sum())
    left.bar(bars.edges_s[:-1], share, width=np.diff(bars.edges_s), align="edge", color=BEST, edgecolor="white")
    left.set_title(said("histogram", language), fontsize=10)
    left.set_xlabel(said("running_time", language))
    left.set_ylabel(said("share", language))
    middle.set_title(said("scatter", language), fontsize=10)
    if margin is not None:
        low, high = margin.reference_s - margin.within_s, margin.reference_s + margin.within_s
        middle.axvspan(low, high, color="#f3d9a4", alpha=0.6, linewidth=0, label=f"±{margin.within_s:g} s")
        middle.axvline(margin.reference_s, color="#b9770e", linewidth=1.0, label=said(margin.reference, language))
    middle.plot(group.times_s, group.energies, "o", color="#444444", markersize=4, alpha=0.7)
    middle.set_xlabel(said("running_time", language))
    middle.set_ylabel(said("energy", language))
    right.set_title(said("margin_bars", language), fontsize=9)
    right.set_xlim(-0.6, 1.6)
    right.set_xticks([0, 1], [said("mean", language), said("minimum", language)])
    if margin is not None:
        best = margin.best
        at = group.energies[[row is best for row in group.rows]]
        middle.plot(best.running_time_s, at[0], "o", color=LIMIT, markersize=7, label=said("best", language))
        middle.legend(fontsize=8)
        right.bar([0, 1], [margin.mean, margin.minimum], color=[GREY, BEST], width=0.6)
        for x, value in enumerate((margin.mean, margin.minimum)):
            right.text(x, value, f"{value:.3f}", ha="center", va="bottom", fontsize=9)
        right.set_ylim(0.0, 1.35 * margin.mean)
        text = (
            f"{said('margin', language)} {100 * margin.margin:.1f} %\n({100 * margin.low:.1f}–{100 * margin.high:.1f})"
        )
        right.text(0.5, 1.18 * margin.mean, text, ha="center", fontsize=9)
    return figure
