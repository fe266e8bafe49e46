"""Readings gathered into passes, and passes into sections: the mean of each quantity where the train was."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from typing import Final

import msgspec
import numpy as np

from services.radio_anomaly.held_places import FASTEST_MPS, placed_by_time
from services.radio_anomaly.reading import Reading
from services.radio_anomaly.settings import Settings

JUMP_M: Final = 500.0
"""A place this far from the median of its neighbours in time is a jump of the position."""
ASTRAY_NS: Final = 43_200_000_000_000
"""A reading half a day from the middle of its pass is stamped by a clock that was set meanwhile."""
QUANTITIES: Final = {
    "power": "power_dbm",
    "decoded": "decoded_power_dbm",
    "reception": "received_ratio",
    "bits": "corrected_bits",
    "frequency": "frequency_offset_hz",
    "temperature": "temperature_c",
    "transmit": "tx_power_dbm",
}
"""Name in the analysis, and the reading's field."""


class Bin(msgspec.Struct, frozen=True, gc=False):
    """One quantity of one radio and channel in one section on one pass, on one cell."""

    quantity: str
    radio: str
    channel: str
    section: int
    cell: str
    count: int
    value: float


class Journey(msgspec.Struct, frozen=True, kw_only=True):
    """One pass over the line (or one period at a site), binned."""

    pass_id: str
    direction: str
    """`up`, `down`; empty at a site."""
    first_ns: int
    last_ns: int
    bins: tuple[Bin, ...]
    passed: tuple[int, ...]
    """Sections that the train was in, or went through without a break of its place, whatever it heard there."""
    heard: frozenset[tuple[str, str, int]]
    """Radio, channel and section with a power."""

    @property
    def day(self) -> str:
        """Date of its first reading, UTC."""
        return day_of(self.first_ns)


def day_of(t_ns: int) -> str:
    """ISO date, UTC."""
    return datetime.fromtimestamp(t_ns // 1_000_000_000, UTC).strftime("%Y-%m-%d")


def transformed(quantity: str, value: float) -> float:
    """On the scale on which a quantity scatters alike everywhere.

    Reception r as 2 asin √r, whose variance does not hang on r (Fisher's angular transformation); corrected bits b as
    ln(1 + b).

    >>> transformed("reception", 1.0) == math.pi
    True
    """
    if quantity == "reception":
        return 2.0 * math.asin(math.sqrt(min(max(value, 0.0), 1.0)))
    return math.log1p(value) if quantity == "bits" else value


def plain(quantity: str, value: float) -> float:
    """Back from `transformed`."""
    if quantity == "reception":
        return math.sin(min(max(value, 0.0), math.pi) / 2.0) ** 2
    return math.expm1(value) if quantity == "bits" else value


def section_of(chainage_m: float, section_m: float) -> int:
    """Section that a place is in, counted from kilometrage 0."""
    return math.floor(chainage_m / section_m)


def sorted_passes(readings: Iterable[Reading], settings: Settings) -> tuple[list[list[Reading]], Counter[str]]:
    """Readings by pass in order of their first times, and what was left out: a clock or a place that jumps, repeats."""
    groups: defaultdict[tuple[str, str], list[Reading]] = defaultdict(list)
    for one in readings:
        groups[pass_of(one, settings)].append(one)
    left: Counter[str] = Counter()
    passes = [kept for group in groups.values() if (kept := _clean(group, left))]
    passes.sort(key=lambda group: (group[0].t_ns, group[0].pass_id, group[0].direction or ""))
    return passes, left


def pass_of(reading: Reading, settings: Settings) -> tuple[str, str]:
    """Name and direction of the pass that a reading belongs to: a day's or a period's where it names none."""
    site = reading.direction is None
    name = reading.pass_id or (period_of(reading.t_ns, settings.period_s) if site else day_of(reading.t_ns))
    return name, reading.direction or ""


def period_of(t_ns: int, period_s: float) -> str:
    """Name of the period that a time lies in: its begin."""
    begin_s = math.floor(t_ns / 1e9 / period_s) * period_s
    return datetime.fromtimestamp(begin_s, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _clean(group: list[Reading], left: Counter[str]) -> list[Reading]:
    """One pass in order of time, without what cannot be."""
    middle_ns = sorted(one.t_ns for one in group)[len(group) // 2]
    near = [one for one in group if abs(one.t_ns - middle_ns) <= ASTRAY_NS]
    left["a time half a day from its pass: the clock was set"] += len(group) - len(near)
    near.sort(key=lambda one: one.t_ns)
    unique = list(dict.fromkeys(near))
    left["reported twice"] += len(near) - len(unique)
    placed = [one for one in unique if one.chainage_m is not None]
    if len(placed) < 5:  # noqa: PLR2004 - a median of five needs five
        return unique
    places = np.array([one.chainage_m for one in placed])
    padded = np.pad(places, 2, mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    astray = {id(one) for one, far in zip(placed, np.abs(places - middle) > JUMP_M, strict=True) if far}
    left["a place that jumps"] += len(astray)
    return [one for one in unique if id(one) not in astray]


def binned(readings: Sequence[Reading], settings: Settings, pass_id: str = "") -> Journey:
    """One pass, whose readings are in order of time. Raises ValueError without readings."""
    if not readings:
        msg = "a pass without readings"
        raise ValueError(msg)
    readings = placed_by_time(readings)
    sums: defaultdict[tuple[str, str, str, int, str], list[float]] = defaultdict(lambda: [0.0, 0.0])
    totals: Counter[tuple[str, str, str, int]] = Counter()
    heard: set[tuple[str, str, int]] = set()
    for one in readings:
        section = 0 if one.chainage_m is None else section_of(one.chainage_m, settings.section_m)
        if one.power_dbm is not None or one.decoded_power_dbm is not None:
            heard.add((one.radio, one.channel, section))
        for quantity, field in QUANTITIES.items():
            value = getattr(one, field)
            if value is None:
                continue
            entry = sums[(quantity, one.radio, one.channel, section, one.cell)]
            entry[0] += 1.0
            entry[1] += value
            totals[(quantity, one.radio, one.channel, section)] += 1
    bins = tuple(
        Bin(*key, int(count), transformed(key[0], total / count))
        for key, (count, total) in sorted(sums.items())
        if totals[key[:4]] >= settings.least_samples
    )
    first = readings[0]
    name, direction = pass_of(first, settings)
    return Journey(
        pass_id=pass_id or name,
        direction=direction,
        first_ns=first.t_ns,
        last_ns=readings[-1].t_ns,
        bins=bins,
        passed=_passed(readings, settings),
        heard=frozenset(heard),
    )


def _passed(readings: Sequence[Reading], settings: Settings) -> tuple[int, ...]:
    """Sections between readings that follow each other at a speed that a train can have, and those of readings."""
    found: set[int] = set()
    before: Reading | None = None
    for one in readings:
        if one.chainage_m is None:
            found.add(0)
            continue
        here = section_of(one.chainage_m, settings.section_m)
        found.add(here)
        if before is not None and before.chainage_m is not None:
            gap_m = abs(one.chainage_m - before.chainage_m)
            gap_s = (one.t_ns - before.t_ns) / 1e9
            if gap_m <= FASTEST_MPS * max(gap_s, 1.0) and gap_m >= SLOWEST_MPS * gap_s:
                there = section_of(before.chainage_m, settings.section_m)
                found.update(range(min(here, there), max(here, there) + 1))
        before = one
    return tuple(sorted(found))


SLOWEST_MPS: Final = 1.0
"""A train that took longer over a gap stood meanwhile, perhaps switched off: nothing was expected of its radio."""
