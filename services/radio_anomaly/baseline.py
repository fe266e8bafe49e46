"""What is normal: mean and spread between passes by section, direction and cell, from mergeable daily sums.

A section's mean is drawn from five sources, each with the variance that it has as a witness for this
section, this direction and this cell: the section itself (σ²/n), the same cell in the other direction
(τ_d² + σ²/n), the same cell in neighbouring sections (τ_n² + σ²/n), other cells hereabouts
(τ_c² + σ²/n), and the whole line (τ_l²). With w the inverse of those variances,

    A = Σ w a / Σ w,    var A = 1 / Σ w.

Where much was learned the section decides alone, where little was, its neighbours help, and how sure the
mean is comes out with it. σ² is pooled over neighbouring sections and shrunk towards that of the whole line.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from datetime import date
from typing import Final

import msgspec

PRIOR_SD: Final[dict[str, float]] = {
    "power": 3.0,
    "decoded": 3.0,
    "reception": 0.25,
    "bits": 0.3,
    "frequency": 50.0,
    "temperature": 5.0,
    "transmit": 1.0,
}
"""Spread between passes that is taken for granted until passes tell: dB, transformed ratio, ln bits, Hz, °C."""
LINE_SHARE: Final = 16.0
CELL_SHARE: Final = 11.0
NEAR_SHARE: Final = 2.2
DIRECTION_SHARE: Final = 0.55
"""τ² as multiples of the prior variance; from the differences between such means on the learning half of one road
line (docs/radio_anomaly.md), and not touchy: half or twice of each changes the likelihood by less than 2 %."""
NEIGHBOURS: Final = 3
"""Sections to each side that help with a mean,"""
SPREAD_WEIGHTS: Final = ((0, 1.0), (-1, 0.6), (1, 0.6), (-2, 0.3), (2, 0.3))
"""and with a spread."""
SPREAD_PRIOR: Final = 4.0
"""Degrees of freedom with which the line's spread counts in a section's."""
FORGOTTEN: Final = 0.02
"""Weight below which a day counts no more."""

Group = tuple[str, int, str]
"""Direction, section, cell."""
Mask = Callable[[str, int, str], str | None]
"""Direction, section, day: `learned`, `accepted` (also what was withheld counts) or None (not at all)."""


class Prediction(msgspec.Struct, frozen=True, gc=False):
    """Mean, its variance, variance between passes, and passes that it rests on here."""

    mean: float
    mean_variance: float
    variance: float
    passes: float


class Sums(msgspec.Struct, gc=False):
    """n, Σ, Σ²."""

    n: float = 0.0
    total: float = 0.0
    squares: float = 0.0

    def add(self, n: float, total: float, squares: float, weight: float = 1.0) -> None:
        """Merge."""
        self.n += weight * n
        self.total += weight * total
        self.squares += weight * squares

    @property
    def mean(self) -> float:
        """Of what was merged."""
        return self.total / self.n


class Book:
    """Daily sums of one quantity of one radio and channel: learned, and withheld from learning."""

    def __init__(self) -> None:
        """Empty."""
        self.learned: dict[Group, dict[str, Sums]] = {}
        self.withheld: dict[Group, dict[str, Sums]] = {}

    def add(self, day: str, group: Group, sums: Sums, *, withheld: bool = False) -> None:
        """Merge sums of a day."""
        book = self.withheld if withheld else self.learned
        book.setdefault(group, {}).setdefault(day, Sums()).add(sums.n, sums.total, sums.squares)

    def merged(self, half_life_days: float, mask: Mask | None) -> dict[Group, Sums]:
        """Sums over the days, older ones weighing less, counted back from the newest day learned."""
        days = {day for of_day in self.learned.values() for day in of_day}
        if not days:
            return {}
        newest = date.fromisoformat(max(days))
        weights = {day: 0.5 ** ((newest - date.fromisoformat(day)).days / half_life_days) for day in days}
        found: dict[Group, Sums] = {}
        for group, of_day in self.learned.items():
            for day, sums in of_day.items():
                if weights[day] > FORGOTTEN and (mask is None or mask(group[0], group[1], day) is not None):
                    found.setdefault(group, Sums()).add(sums.n, sums.total, sums.squares, weights[day])
        if mask is not None:
            for group, of_day in self.withheld.items():
                for day, sums in of_day.items():
                    if mask(group[0], group[1], day) == "accepted":
                        found.setdefault(group, Sums()).add(sums.n, sums.total, sums.squares)
        return found


class Baseline:
    """One quantity of one radio and channel, fitted."""

    def __init__(self, quantity: str, groups: dict[Group, Sums]) -> None:
        """From merged sums."""
        self._unit = PRIOR_SD[quantity] ** 2
        self._groups = groups
        self._cells: defaultdict[int, dict[str, Sums]] = defaultdict(dict)
        self._places: defaultdict[int, Sums] = defaultdict(Sums)
        self._scatter: defaultdict[int, list[float]] = defaultdict(lambda: [0.0, 0.0])
        line = Sums()
        for (_, section, cell), sums in groups.items():
            self._cells[section].setdefault(cell, Sums()).add(sums.n, sums.total, sums.squares)
            self._places[section].add(sums.n, sums.total, sums.squares)
            line.add(sums.n, sums.total, sums.squares)
            if sums.n > 1.0:
                entry = self._scatter[section]
                entry[0] += max(sums.squares - sums.total**2 / sums.n, 0.0)
                entry[1] += sums.n - 1.0
        self.line_mean = line.mean if line.n else 0.0
        squares, freedom = (sum(entry[k] for entry in self._scatter.values()) for k in (0, 1))
        self.line_variance = (squares + self._unit) / (freedom + 1.0)
        self._memory: dict[tuple[str, int, str], Prediction] = {}

    def sections(self) -> list[int]:
        """Those with something learned."""
        return sorted(self._places)

    def variance(self, section: int) -> float:
        """Between passes: pooled over neighbours, shrunk towards the line's."""
        squares = freedom = 0.0
        for offset, weight in SPREAD_WEIGHTS:
            entry = self._scatter.get(section + offset)
            if entry is not None:
                squares += weight * entry[0]
                freedom += weight * entry[1]
        return (squares + SPREAD_PRIOR * self.line_variance) / (freedom + SPREAD_PRIOR)

    def predict(self, direction: str, section: int, cell: str) -> Prediction:
        """What the next pass should show."""
        key = (direction, section, cell)
        if key not in self._memory:
            self._memory[key] = self._predict(*key)
        return self._memory[key]

    def _predict(self, direction: str, section: int, cell: str) -> Prediction:
        variance = self.variance(section)
        weights = [1.0 / (LINE_SHARE * self._unit)]
        means = [self.line_mean]

        def witness(mean: float, weight: float) -> None:
            means.append(mean)
            weights.append(weight)

        others, other_weight, near, near_weight = self._around(section, cell)
        if other_weight:
            witness(others / other_weight, 1.0 / (CELL_SHARE * self._unit + variance / other_weight))
        if near_weight:
            witness(near / near_weight, 1.0 / (NEAR_SHARE * self._unit + variance / (2.0 * near_weight)))
        same = self._cells[section].get(cell) if section in self._cells else None
        exact = self._groups.get((direction, section, cell))
        if same is not None:
            n = same.n - (exact.n if exact else 0.0)
            if n > 1e-9:  # noqa: PLR2004 - what is left of a difference of equal sums
                total = same.total - (exact.total if exact else 0.0)
                witness(total / n, 1.0 / (DIRECTION_SHARE * self._unit + variance / n))
        if exact is not None and exact.n:
            witness(exact.mean, exact.n / variance)
        weight = sum(weights)
        mean = sum(w * m for w, m in zip(weights, means, strict=True)) / weight
        here = self._places[section].n if section in self._places else 0.0
        return Prediction(mean, 1.0 / weight, variance, here)

    def _around(self, section: int, cell: str) -> tuple[float, float, float, float]:
        """Weighted means of other cells here and beside, and of this cell beside, with their weights."""
        others = other_weight = near = near_weight = 0.0
        for offset in range(-NEIGHBOURS, NEIGHBOURS + 1):
            place = self._places.get(section + offset)
            if place is None:
                continue
            weight = 1.0 / (1 + abs(offset))
            same = self._cells[section + offset].get(cell)
            n = place.n - (same.n if same else 0.0)
            if n > 1e-9:  # noqa: PLR2004 - as above
                others += weight * (place.total - (same.total if same else 0.0)) / n
                other_weight += weight
            if offset and same is not None and same.n:
                near += weight * same.mean
                near_weight += weight
        return others, other_weight, near, near_weight


def one(value: float, n: float = 1.0) -> Sums:
    """Sums of a single pass value."""
    return Sums(n, n * value, n * value * value)
