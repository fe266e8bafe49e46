"""How much energy lies between the mean run and the cheapest one of like running time (Maki et al., section 4.4)."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median
from typing import Final, Literal

import numpy as np

from services.run_history.run_rows import RunRow
from services.run_history.run_statistics import SMALL_SAMPLE, Group

WITHIN_S: Final = 10.0
DRAWS: Final = 2000
SEED: Final = 20260101
CONFIDENCE: Final = 0.95


@dataclass(frozen=True, slots=True)
class SavingMargin:
    """Energy-saving margin of a group: an upper limit of what alike driving could save."""

    reference_s: float
    """Running time about which runs are taken …"""
    reference: Literal["scheduled", "median"]
    """… and where it comes from: the median where no timetable is known."""
    within_s: float
    rows: tuple[RunRow, ...]
    mean: float
    """Of the energy over the mean of the whole group."""
    minimum: float
    margin: float
    """(mean − minimum) / mean."""
    low: float
    """Interval of confidence (95 %) by resampling the runs."""
    high: float
    best: RunRow
    """The representative energy-saving run."""

    @property
    def small(self) -> bool:
        """Too few runs for more than a hint."""
        return len(self.rows) < SMALL_SAMPLE


def reference_time(group: Group) -> tuple[float, Literal["scheduled", "median"]]:
    """Scheduled running time of a group, its median where none is known. Raises ValueError for an empty group."""
    scheduled = [row.scheduled_s for row in group.rows if row.scheduled_s is not None]
    if scheduled:
        return float(median(scheduled)), "scheduled"
    return float(np.median(group.times_s)) if group.rows else _empty(), "median"


def _empty() -> float:
    msg = "no run counts in this group"
    raise ValueError(msg)


def saving_margin(group: Group, within_s: float = WITHIN_S, seed: int = SEED) -> SavingMargin | None:
    """Margin among the runs within `within_s` of the reference time; None when there is none.

    The interval resamples the runs with replacement (Efron 1979, percentiles). A resample's cheapest run is never
    cheaper than the cheapest observed, so the interval leans to lower margins: it is a careful one.
    """
    if not group.rows:
        return None
    reference_s, kind = reference_time(group)
    near = np.abs(group.times_s - reference_s) <= within_s
    if not near.any():
        return None
    energies = group.energies[near]
    rows = tuple(row for row, taken in zip(group.rows, near, strict=True) if taken)
    mean, minimum = float(energies.mean()), float(energies.min())
    if mean <= 0.0:
        return None
    draws = energies[np.random.default_rng(seed).integers(0, len(energies), (DRAWS, len(energies)))]
    means = draws.mean(axis=1)
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.percentile((means - draws.min(axis=1)) / means, [tail, 100.0 - tail])
    return SavingMargin(
        reference_s,
        kind,
        within_s,
        rows,
        mean,
        minimum,
        (mean - minimum) / mean,
        float(low),
        float(high),
        rows[int(np.argmin(energies))],
    )
