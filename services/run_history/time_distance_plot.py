"""Time–distance diagram (スジ) of all legs over the time of day, and reception along the line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from services.run_history.reception_survey import Reception
from services.run_history.report_words import Language, said
from services.run_history.run_report import RunReport
from services.run_history.run_statistics import local_hour


def time_distance(report: RunReport, language: Language) -> Figure:
    """Place over the time of day, days on top of each other, up and down in two colours."""
    figure = Figure(figsize=(10.5, 5.2), layout="constrained")
    axes = figure.subplots()
    named: set[bool] = set()
    for journey in report.journeys:
        trace, up = journey.trace, journey.up
        hour = local_hour(trace.departure_s, report.selection.zone) + trace.time_s / 3600.0
        place = (journey.start_axis_m + (1.0 if up else -1.0) * trace.way_m) / 1000.0
        label = said("up" if up else "down", language) if up not in named else "_"
        named.add(up)
        axes.plot(hour, place, color="#1f5fa8" if up else "#c0392b", linewidth=0.9, label=label)
    places = [place / 1000.0 for _, place in report.stations]
    axes.set_yticks(places, [f"{name} {place:.1f}" for (name, _), place in zip(report.stations, places, strict=True)])
    axes.grid(visible=True, color="#d5d5d5", linewidth=0.6)
    axes.set_xlabel(said("clock", language))
    axes.set_ylabel(said("place", language))
    if named:
        axes.legend(loc="upper right", fontsize=8)
    return figure


def reception_strip(reception: Sequence[Reception], language: Language) -> Figure:
    """Missing speeds and missing time by stretch of the line."""
    figure = Figure(figsize=(10.5, 3.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    start = np.array([one.start_axis_m / 1000.0 for one in reception])
    width = np.array([(one.end_axis_m - one.start_axis_m) / 1000.0 for one in reception])
    share = [100.0 * one.without_speed_share for one in reception]
    upper.bar(start, share, width=width, align="edge", color="#b9770e")
    upper.set_ylabel(said("without_speed", language), fontsize=8)
    upper.set_ylim(0.0, max(5.0, *share) if share else 5.0)
    missing = [one.missing_s for one in reception]
    lower.bar(start, missing, width=width, align="edge", color="#6b6b6b")
    lower.set_ylim(0.0, max(5.0, *missing) if missing else 5.0)
    lower.set_ylabel(said("missing", language), fontsize=8)
    lower.set_xlabel(said("place", language))
    return figure
