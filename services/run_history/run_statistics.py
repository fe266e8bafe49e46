"""Legs by section, direction and series: which count, how long they took, what they cost against each other.

After Maki et al., sections 2.2 and 4.3: quiet hours only, energy over the mean of section and series.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Final, Literal
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from services.run_history.run_rows import RunRow

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
BAR_S: Final = 10.0
SMALL_SAMPLE: Final = 10
"""Fewer runs than this say little, and are told so."""
_FIGURES: Final = re.compile(r"(?:\b(?:of|by|over)\s+)?[\d.]+\s?(?:%|(?:km/h|m/s|s|m)\b)(?:\s+of\b)?")
OUTSIDE_HOURS: Final = "outside the hours"


@dataclass(frozen=True, slots=True)
class Selection:
    """Which departures count; the article takes 10 to 16 o'clock, when other trains disturb least."""

    from_h: float = 10.0
    until_h: float = 16.0
    zone: str = "Asia/Tokyo"

    def holds(self, departure_s: float) -> bool:
        """Whether a departure (Unix time) lies within the hours; those that run over midnight are understood."""
        hour = local_hour(departure_s, self.zone)
        if self.from_h <= self.until_h:
            return self.from_h <= hour < self.until_h
        return hour >= self.from_h or hour < self.until_h


def local_hour(t_unix_s: float, zone: str) -> float:
    """Hour of the day with its fraction. Raises ZoneInfoNotFoundError for an unknown zone."""
    at = datetime.fromtimestamp(t_unix_s, ZoneInfo(zone))
    return at.hour + at.minute / 60.0 + at.second / 3600.0


@dataclass(frozen=True, slots=True)
class Group:
    """Runs of one section, direction and series."""

    start: str
    end: str
    direction: Literal["up", "down"]
    series: str
    rows: tuple[RunRow, ...]
    """Those that count, in order of departure."""
    left_out: tuple[tuple[str, int], ...]
    """Why others do not, with their number, most frequent first."""

    @property
    def small(self) -> bool:
        """Too few for more than a hint."""
        return len(self.rows) < SMALL_SAMPLE

    @property
    def times_s(self) -> Floats:
        """Running times, shape (n,)."""
        return np.array([row.running_time_s for row in self.rows])

    @property
    def energies(self) -> Floats:
        """Energy over the mean of the group, shape (n,)."""
        energy = np.array([row.energy_kwh for row in self.rows])
        mean = float(energy.mean()) if len(energy) else 0.0
        return energy / mean if mean > 0.0 else np.zeros(len(energy))


def groups_of(rows: Sequence[RunRow], selection: Selection) -> list[Group]:
    """Groups in order of direction, section and series. A leg that is there twice (same run and departure) counts once.

    Raises ZoneInfoNotFoundError.
    """
    counted: dict[tuple[str, str, str, str], list[RunRow]] = defaultdict(list)
    left: dict[tuple[str, str, str, str], Counter[str]] = defaultdict(Counter)
    seen: set[tuple[str, str, str, float]] = set()
    for row in sorted(rows, key=lambda one: (one.departure_s, one.run_id)):
        key = (row.direction, row.start, row.end, row.series)
        same = (row.run_id, row.start, row.end, row.departure_s)
        if same in seen:
            left[key]["there twice"] += 1
        elif row.excluded_because:
            left[key][_kind(row.excluded_because)] += 1
        elif not selection.holds(row.departure_s):
            left[key][OUTSIDE_HOURS] += 1
        else:
            counted[key].append(row)
        seen.add(same)
    return [
        Group(start, end, _direction(direction), series, tuple(counted[key]), tuple(left[key].most_common()))
        for key in sorted({*counted, *left})
        for direction, start, end, series in (key,)
    ]


def _direction(text: str) -> Literal["up", "down"]:
    return "up" if text == "up" else "down"


def _kind(reason: str) -> str:
    """The first reason without its figures, so that like is counted with like."""
    return _FIGURES.sub("", reason.split(";", maxsplit=1)[0]).strip()


@dataclass(frozen=True, slots=True)
class Histogram:
    """Bars of running time: bar k is from `edges_s[k]` up to `edges_s[k + 1]`."""

    edges_s: Floats
    counts: Ints


def histogram(times_s: Floats, bar_s: float = BAR_S) -> Histogram:
    """Histogram with edges at multiples of the bar's width; no bars for no times."""
    if len(times_s) == 0:
        return Histogram(np.zeros(0), np.zeros(0, np.int64))
    low = np.floor(times_s.min() / bar_s)
    bar = (np.floor(times_s / bar_s) - low).astype(np.int64)
    counts = np.bincount(bar)
    return Histogram((low + np.arange(len(counts) + 1)) * bar_s, counts)
