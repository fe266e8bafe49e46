"""Power with its thresholds along the line (Nakaune, Figures 5 to 7), the passes as a surface (Figure 4), events.

The same input gives the same bytes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.ticker import MaxNLocator

from schemas.radio import RadioEvent
from services.radio_anomaly.file_analysis import paper_thresholds
from services.radio_anomaly.monitor import by_stream
from services.radio_anomaly.passes import Journey
from services.radio_anomaly.radio_model import RadioModel, monitor_of
from services.radio_anomaly.window_test import Floats

DOTS_PER_INCH: Final = 80
STREAMS: Final = 3
"""Radios and channels shown, those with most sections."""
TABLE_ROWS: Final = 8
KINDS: Final = {"above": "#c0392b", "below": "#1f5fa8", "missing": "#6b6b6b", "trend": "#b9770e"}
Limits = tuple[Floats, Floats, Floats, Floats]
"""Kilometrage, mean, lower, upper."""


def draw_model(model: RadioModel) -> Figure:
    """What is normal: mean and A ± kσ along the line by radio, channel and direction."""
    streams = Counter((row.radio, row.channel) for row in model.sums if row.quantity in ("power", "decoded", "sample"))
    shown = [key for key, _ in streams.most_common(STREAMS)]
    figure = Figure(figsize=(10.0, 2.8 * max(len(shown), 1)), dpi=DOTS_PER_INCH, layout="constrained")
    for number, key in enumerate(shown):
        axes = figure.add_subplot(max(len(shown), 1), 1, number + 1)
        for direction, colour in (("up", "#1f5fa8"), ("down", "#2e8b57")):
            limits = limits_of(model, key, direction)
            if limits is not None:
                _band(axes, limits, colour, direction if model.method == "line" else "both directions")
            if model.method == "paper":
                break
        _finish(axes, f"{key[0]} {key[1]}: mean and A ± {model.settings.k:g}σ")
    return figure


def limits_of(model: RadioModel, key: tuple[str, str], direction: str) -> Limits | None:
    """Thresholds by section; where a section knows several cells, those of the cell heard most."""
    section_m = model.settings.section_m
    rows: list[tuple[float, float, float, float]] = []
    if model.method == "paper":
        for (radio, channel, section), one in sorted(paper_thresholds(model).items()):
            if (radio, channel) == key:
                rows.append((_middle_km(section, section_m), one.mean_dbm, one.lower_dbm, one.upper_dbm))
    else:
        monitor = monitor_of(model)
        quantity = "power" if any(r.quantity == "power" for r in model.sums) else "decoded"
        baseline = monitor.streams[key].baseline(quantity, model.settings.half_life_days, monitor.mask(key))
        heard: dict[int, Counter[str]] = {}
        for row in model.sums:
            if (row.radio, row.channel) == key and row.quantity == quantity and row.direction in (direction, ""):
                heard.setdefault(row.section, Counter())[row.cell] += round(row.n)
        for section, cells in sorted(heard.items()):
            found = baseline.predict(direction, section, cells.most_common(1)[0][0])
            width = model.settings.k * (found.variance + found.mean_variance) ** 0.5
            rows.append((_middle_km(section, section_m), found.mean, found.mean - width, found.mean + width))
    if not rows:
        return None
    # A hole in what was learned is a hole in the band.
    holes = [k for k in range(1, len(rows)) if rows[k][0] - rows[k - 1][0] > 1.5 * section_m / 1000.0]
    table = np.insert(np.array(rows), holes, np.nan, axis=0)
    return table[:, 0], table[:, 1], table[:, 2], table[:, 3]


def draw_analysis(model: RadioModel, journeys: Sequence[Journey], events: Sequence[RadioEvent]) -> Figure:
    """The pass with the clearest event on its thresholds, all passes as a surface, and the events as a table."""
    told = [one for one in events if one.phase != "ended"]
    clearest = max(told, key=lambda one: (one.confirmed, abs(one.score)), default=None)
    key, journey = _shown(journeys, clearest)
    figure = Figure(figsize=(11.0, 8.5), dpi=DOTS_PER_INCH, layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(1.1, 1.3, 0.8))
    axes = figure.add_subplot(grid[0, :])
    if journey is not None and key is not None:
        limits = limits_of(model, key, journey.direction)
        if limits is not None:
            _band(axes, limits, "#888888", "thresholds")
        km, power = _powers(journey, key, model.settings.section_m)
        axes.plot(km, power, color="#111111", linewidth=1.2, marker=".", markersize=4, label=journey.pass_id)
        for event in told:
            if event.pass_id == journey.pass_id and (event.radio, event.channel) == key:
                axes.axvspan(
                    event.section_start_m / 1000.0,
                    event.section_end_m / 1000.0,
                    color=KINDS[event.kind],
                    alpha=0.25 if event.confirmed else 0.1,
                )
        _finish(axes, f"{key[0]} {key[1]} {journey.direction}")
        _surface(figure, grid[1, 0], journeys, key, model.settings.section_m)
        _image(figure.add_subplot(grid[1, 1]), journeys, key, told, model.settings.section_m)
    table = figure.add_subplot(grid[2, :])
    table.axis("off")
    _table(table, told)
    return figure


def _shown(journeys: Sequence[Journey], event: RadioEvent | None) -> tuple[tuple[str, str] | None, Journey | None]:
    if event is not None:
        key = (event.radio, event.channel)
        for journey in journeys:
            if (journey.pass_id, journey.direction) == (event.pass_id, event.direction or ""):
                return key, journey
    counts = Counter(key for journey in journeys for key in by_stream(journey))
    if not counts:
        return None, None
    return counts.most_common(1)[0][0], journeys[-1]


def _powers(journey: Journey, key: tuple[str, str], section_m: float) -> tuple[Floats, Floats]:
    bins = by_stream(journey).get(key, [])
    quantity = "power" if any(b.quantity == "power" for b in bins) else "decoded"
    sums: dict[int, list[float]] = {}
    for b in bins:
        if b.quantity == quantity:
            entry = sums.setdefault(b.section, [0.0, 0.0])
            entry[0] += b.count
            entry[1] += b.count * b.value
    order = sorted(sums)
    # A hole in the samples is a hole in the line drawn.
    km, power = [], []
    for at, section in enumerate(order):
        if at and section > order[at - 1] + 1:
            km.append(_middle_km(section - 1, section_m))
            power.append(np.nan)
        km.append(_middle_km(section, section_m))
        power.append(sums[section][1] / sums[section][0])
    return np.array(km), np.array(power)


def _passes_table(
    journeys: Sequence[Journey], key: tuple[str, str], section_m: float
) -> tuple[Floats, Floats, list[Journey]] | None:
    mine = [one for one in journeys if key in by_stream(one)]
    columns = [_powers(one, key, section_m) for one in mine]
    sections = sorted({round(float(x) * 1000.0 / section_m - 0.5) for km, _ in columns for x in km})
    if not sections:
        return None
    low = sections[0]
    table = np.full((len(mine), sections[-1] - low + 1), np.nan)
    for row, (km, power) in enumerate(columns):
        for x, value in zip(km, power, strict=True):
            table[row, round(float(x) * 1000.0 / section_m - 0.5) - low] = value
    middles_km = (np.arange(low, sections[-1] + 1, dtype=np.float64) + 0.5) * (section_m / 1000.0)
    return middles_km, table, mine


def _surface(
    figure: Figure, cell: SubplotSpec, journeys: Sequence[Journey], key: tuple[str, str], section_m: float
) -> None:
    found = _passes_table(journeys, key, section_m)
    if found is None:
        return
    km, table, _ = found
    axes: Any = figure.add_subplot(cell, projection="3d")
    colours = mpl.colormaps["viridis"](np.linspace(0.0, 0.95, len(table)))
    for row in range(len(table)):
        axes.plot(km, np.full(len(km), row + 1), table[row], color=colours[row], linewidth=0.8)
    axes.set_xlabel("kilometrage [km]", fontsize=8)
    axes.set_ylabel("pass", fontsize=8)
    axes.set_zlabel("power [dBm]", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.yaxis.get_major_locator().set_params(integer=True)
    axes.view_init(elev=28.0, azim=-62.0)
    axes.set_box_aspect((1.6, 1.0, 0.8), zoom=0.9)


def _image(
    axes: Axes, journeys: Sequence[Journey], key: tuple[str, str], events: Sequence[RadioEvent], section_m: float
) -> None:
    found = _passes_table(journeys, key, section_m)
    if found is None:
        return
    km, table, mine = found
    half = section_m / 2000.0
    picture = axes.imshow(
        table,
        aspect="auto",
        origin="lower",
        interpolation="nearest",
        cmap="viridis",
        extent=(float(km[0]) - half, float(km[-1]) + half, 0.5, len(mine) + 0.5),
    )
    rows = {(one.pass_id, one.direction): row for row, one in enumerate(mine, start=1)}
    for event in events:
        row = rows.get((event.pass_id, event.direction or ""))
        if row is not None and event.confirmed and (event.radio, event.channel) == key:
            axes.plot(
                (event.section_start_m / 1000.0, event.section_end_m / 1000.0),
                (row, row),
                color=KINDS[event.kind],
                linewidth=2.0,
            )
    axes.set_xlabel("kilometrage [km]")
    axes.set_ylabel("pass")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    figure = axes.figure
    figure.colorbar(picture, ax=axes, label="dBm")


def _table(axes: Axes, events: Sequence[RadioEvent]) -> None:
    newest: dict[str, RadioEvent] = {one.event_id: one for one in events}
    ordered = sorted(newest.values(), key=lambda one: (not one.confirmed, -abs(one.score)))[:TABLE_ROWS]
    rows = [
        [
            one.pass_id[-16:],
            f"{one.radio} {one.channel}"[:20],
            f"{one.section_start_m / 1000.0:.1f}–{one.section_end_m / 1000.0:.1f} km",
            one.kind + ("" if one.confirmed else "?"),
            one.cause,
            "" if one.value_dbm is None else f"{one.value_dbm:.0f} dBm",
            f"{one.score:+.1f}",
        ]
        for one in ordered
    ]
    heads = ["pass", "radio", "stretch", "kind", "cause", "power", "score"]
    if not rows:
        axes.text(0.5, 0.5, "no events", ha="center")
        return
    table = axes.table(cellText=rows, colLabels=heads, loc="upper center", cellLoc="left")
    table.auto_set_font_size(False)  # noqa: FBT003 - matplotlib takes it by place
    table.set_fontsize(8)


def _band(axes: Axes, limits: Limits, colour: str, label: str) -> None:
    km, mean, lower, upper = limits
    axes.fill_between(km, lower, upper, color=colour, alpha=0.18, linewidth=0)
    axes.plot(km, mean, color=colour, linewidth=1.1, label=f"mean, {label}")
    for edge in (lower, upper):
        axes.plot(km, edge, color=colour, linewidth=0.7, linestyle=(0, (4, 2)))


def _finish(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("kilometrage [km]")
    axes.set_ylabel("power [dBm]")
    axes.grid(visible=True, color="#dddddd", linewidth=0.5)
    axes.legend(loc="upper right", fontsize=8)


def _middle_km(section: int, section_m: float) -> float:
    return (section + 0.5) * section_m / 1000.0


def save(figure: Figure, path: Path) -> None:
    """Write beside, then rename; the ending decides the form. Raises ValueError for one that is unknown, OSError."""
    if path.suffix not in (".png", ".svg", ".pdf"):
        msg = f"{path}: pictures end in .png, .svg or .pdf"
        raise ValueError(msg)
    beside = path.with_name(f"{path.stem}.new{path.suffix}")
    dated = {"CreationDate": None} if path.suffix == ".pdf" else {"Date": None} if path.suffix == ".svg" else {}
    with mpl.rc_context({"svg.hashsalt": "kirotei", "font.size": 9.0}):
        FigureCanvasAgg(figure)
        figure.savefig(beside, metadata=dated or None)
    beside.replace(path)
