"""Legs as rows: what statistics, reports and the store go by."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from services.run_history.run_analysis import LegRun


@dataclass(frozen=True, slots=True)
class RunRow:
    """One leg of one run."""

    run_id: str
    start: str
    end: str
    departure_s: float
    """Unix time."""
    arrival_s: float
    running_time_s: float
    energy_kwh: float
    """Traction alone."""
    energy_sigma_kwh: float
    energy_normalised: float | None
    """Over the mean of section and series; None where it does not count."""
    series: str
    direction: Literal["up", "down"]
    scheduled_s: float | None
    window_s: float | None
    """Of the moving average; None: the smoother."""
    quality: float
    excluded_because: str
    energy_noise_kwh: float | None = None
    """Taken off the traction energy for noise in the speeds. None here and below: a table that did not tell."""
    energy_noise_sigma_kwh: float | None = None
    regenerated_kwh: float | None = None
    """Apart from `energy_kwh`, as the auxiliaries."""
    regenerated_sigma_kwh: float | None = None
    auxiliaries_kwh: float | None = None
    auxiliaries_sigma_kwh: float | None = None


def row_of(leg: LegRun, series: str, scheduled_s: Mapping[tuple[str, str], float], window_s: float | None) -> RunRow:
    """Row of a leg, not normalised yet."""
    start, end = leg.start.name, leg.end.name
    return RunRow(
        leg.run_id,
        start,
        end,
        leg.ends.departure_s,
        leg.ends.arrival_s,
        leg.running_time_s,
        leg.energy.traction_kwh,
        leg.energy.sigma_kwh,
        None,
        series,
        leg.direction,
        scheduled_s.get((start, end)),
        window_s,
        leg.quality,
        leg.excluded_because,
        leg.energy.noise_kwh,
        leg.energy.noise_sigma_kwh,
        leg.energy.regenerated_kwh,
        leg.energy.regenerated_sigma_kwh,
        leg.energy.auxiliaries_kwh,
        leg.energy.auxiliaries_sigma_kwh,
    )


def normalised(rows: Sequence[RunRow]) -> list[RunRow]:
    """Rows with their energy over the mean of those that count, by section and series (Maki et al., section 4.3)."""
    groups: dict[tuple[str, str, str], list[float]] = defaultdict(list)
    for row in rows:
        if not row.excluded_because:
            groups[row.start, row.end, row.series].append(row.energy_kwh)
    found = []
    for row in rows:
        energies = groups.get((row.start, row.end, row.series), [])
        mean = sum(energies) / len(energies) if energies else 0.0
        counts = mean > 0.0 and not row.excluded_because
        found.append(replace(row, energy_normalised=row.energy_kwh / mean if counts else None))
    return found
