"""A line in words: its tables, as people read them, and the same as plain values for JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from schemas.line import Line
from services.line.alignment import Alignment, routes

Row = dict[str, Any]


def summary_of(line: Line, alignment: Alignment) -> dict[str, Any]:
    """Everything about a route as plain values, places both as `axis_m` and as kilometrage."""
    length_m = alignment.length_m
    lat, lon, height = alignment.position([0.0, length_m])
    return {
        "id": line.id,
        "name": line.name,
        "name_ja": line.name_ja,
        "version": line.version,
        "valid_from": line.valid_from,
        "valid_until": line.valid_until,
        "branch": alignment.branch,
        "branches": list(routes(line)[1:]),
        "length_m": round(length_m, 3),
        "vertices": len(alignment.axis.axis_m),
        "start": [round(float(lat[0]), 7), round(float(lon[0]), 7), round(float(height[0]), 2)],
        "end": [round(float(lat[1]), 7), round(float(lon[1]), 7), round(float(height[1]), 2)],
        "chainage_start_m": round(float(alignment.chainage.at(0.0)), 1),
        "chainage_end_m": round(float(alignment.chainage.at(length_m)), 1),
        "broken_chains": _breaks(alignment),
        "stations": [
            {"id": one.id, "name": one.name, "name_ja": one.name_ja, **_place(alignment, one.axis_m)}
            for one in alignment.stations
        ],
        "curves": _curves(alignment),
        "gradients": [{**_place(alignment, one.axis_m), "permille": one.permille} for one in alignment.gradients],
        "speed_limits": [
            {**_stretch(one.start_axis_m, one.end_axis_m), "limit_kmh": round(one.limit_mps * 3.6, 1)}
            for one in alignment.speed_limits
        ],
        "surroundings": [
            {"kind": one.kind, **_stretch(one.start_axis_m, one.end_axis_m)} for one in alignment.surroundings_along
        ],
        "parallel_tracks": [
            {"id": one.id, **_stretch(one.start_axis_m, one.end_axis_m), "aside_m": one.aside_m}
            for one in alignment.parallel_tracks
        ],
        "radio_sites": [{"id": one.id, **_place(alignment, one.axis_m)} for one in line.radio_sites],
        "track_circuits": [{"id": one.id, **_stretch(one.start_axis_m, one.end_axis_m)} for one in line.track_circuits],
        "balises": [{"id": one.id, **_place(alignment, one.axis_m)} for one in alignment.balises],
        "landmarks": [
            {
                "id": one.id,
                "direction": one.direction,
                "hand": one.hand,
                "radius_m": one.radius_m,
                "entry_m": one.entry_lower_limit_m,
                "exit_m": one.exit_lower_limit_m,
                "accuracy_m": one.accuracy_m,
            }
            for one in alignment.landmarks
        ],
    }


def tables_of(summary: dict[str, Any]) -> str:
    """The same as text: a heading, then a table per subject that the line has."""
    route = f", onto branch {summary['branch']}" if summary["branch"] else ""
    japanese = f" {summary['name_ja']}" if summary["name_ja"] and summary["name_ja"] != summary["name"] else ""
    days = f"{summary['valid_from'] or '…'} to {summary['valid_until'] or '…'}"
    kilometrage = f"kilometrage {summary['chainage_start_m']:.0f} to {summary['chainage_end_m']:.0f} m"
    lines = [
        f"{summary['name']}{japanese} ({summary['id']}), version {summary['version'] or 'unstated'}, valid {days}",
        f"{summary['length_m'] / 1000.0:.3f} km{route}, {summary['vertices']} vertices, {kilometrage}",
    ]
    if summary["branches"] and not summary["branch"]:
        lines.append(f"branches: {', '.join(summary['branches'])} (see --branch)")
    subjects = (
        "broken_chains",
        "stations",
        "curves",
        "gradients",
        "speed_limits",
        "surroundings",
        "parallel_tracks",
        "radio_sites",
        "track_circuits",
        "balises",
        "landmarks",
    )
    for subject in subjects:
        if summary[subject]:
            lines += ["", f"{subject.replace('_', ' ')} ({len(summary[subject])})", *_table(summary[subject])]
    return "\n".join(lines)


def _table(rows: Sequence[Row]) -> list[str]:
    """Columns under their names, numbers to the right; columns without any entry are left out."""
    names = [name for name in rows[0] if any(row[name] not in (None, "") for row in rows)]
    cells = [[_cell(row[name]) for name in names] for row in rows]
    widths = [max(_width(name), *(_width(row[k]) for row in cells)) for k, name in enumerate(names)]
    right = [all(isinstance(row[name], int | float) or row[name] is None for row in rows) for name in names]
    return ["  " + "  ".join(_padded(one, widths[k], right[k]) for k, one in enumerate(row)) for row in [names, *cells]]


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.1f}" if isinstance(value, float) else str(value)


def _width(text: str) -> int:
    """Columns on a terminal: Japanese characters take two."""
    return sum(2 if ord(one) > 0x2E7F else 1 for one in text)  # noqa: PLR2004 - where wide characters begin (UAX 11)


def _padded(text: str, width: int, right: bool) -> str:  # noqa: FBT001 - private, and named by its parameter
    space = " " * (width - _width(text))
    return space + text if right else text + space


def _place(alignment: Alignment, axis_m: float) -> Row:
    return {"axis_m": round(axis_m, 1), "chainage_m": round(float(alignment.chainage.at(axis_m)), 1)}


def _stretch(start_m: float, end_m: float) -> Row:
    return {"from_m": round(start_m, 1), "to_m": round(end_m, 1)}


def _curves(alignment: Alignment) -> list[Row]:
    """Curves with their hand, and what the fit was worth where they were fitted."""
    found: list[Row] = []
    for one in alignment.curves:
        arc_m = one.end_axis_m - one.start_axis_m - (one.transition_in_m + one.transition_out_m) / 2.0
        found.append(
            {
                **_stretch(one.start_axis_m, one.end_axis_m),
                "hand": "left" if one.radius_m > 0.0 else "right",
                "radius_m": round(abs(one.radius_m), 1),
                "in_m": round(one.transition_in_m, 1),
                "out_m": round(one.transition_out_m, 1),
                "turn_deg": round(math.degrees(arc_m / abs(one.radius_m)), 1),
                "cant_mm": round(one.cant_mm, 1),
                "radius_sigma_m": one.radius_sigma_m,
                "place_sigma_m": one.place_sigma_m,
            }
        )
    return found


def _breaks(alignment: Alignment) -> list[Row]:
    """Broken chains: where, from which kilometrage to which."""
    given = alignment.chainage
    at: Iterable[int] = np.flatnonzero(np.diff(given.axis_m) == 0.0).tolist()
    return [
        {
            "axis_m": round(float(given.axis_m[k]), 1),
            "ends_at_m": round(float(given.chainage_m[k]), 1),
            "goes_on_at_m": round(float(given.chainage_m[k + 1]), 1),
        }
        for k in at
    ]
