"""Which paths reach an antenna from each satellite: the direct one, reflections, or none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from services.simulator.surroundings import Reflections, Surroundings

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

DIRECT = -1
"""Stands for the direct path where facades are numbered."""
MAX_REFLECTIONS = 4
"""Of more only the strongest count."""
Reception = Literal["line_of_sight", "multipath", "reflected_only", "blocked"]


@dataclass(frozen=True, slots=True)
class Paths:
    """Paths of k satellites in columns: the direct one, then reflections by falling amplitude.

    Shape (k, r); columns without a path have amplitude 0.
    """

    amplitude: Floats
    excess_m: Floats
    excess_rate_mps: Floats
    facade: NDArray[np.int64]
    """DIRECT in the first column and in columns without a path."""

    def reception(self) -> list[Reception]:
        """What each satellite's signal consists of."""
        direct: Bools = self.amplitude[:, 0] > 0
        reflected = np.asarray((self.amplitude[:, 1:] > 0).any(axis=1))
        names: dict[tuple[bool, bool], Reception] = {
            (True, False): "line_of_sight",
            (True, True): "multipath",
            (False, True): "reflected_only",
            (False, False): "blocked",
        }
        return [names[bool(a), bool(b)] for a, b in zip(direct, reflected, strict=True)]


def paths_to(surroundings: Surroundings, position_m: Floats, velocity_mps: Floats, towards: Floats) -> Paths:
    """Paths to an antenna at `position_m` (3,), moving, from satellites in directions `towards` (k, 3).

    All in the line's plane (east, north, up).
    """
    near = surroundings.near(position_m)
    count = len(towards)
    origin = np.broadcast_to(position_m, (count, 3))
    direct = ~surroundings.hidden(near, origin, towards, np.full(count, np.inf))
    if not len(near):
        return _packed(direct, None)
    return _packed(direct, surroundings.reflections(near, position_m, velocity_mps, towards))


def _packed(direct: Bools, reflections: Reflections | None) -> Paths:
    count = len(direct)
    amplitude = np.zeros((count, 1 + MAX_REFLECTIONS))
    excess, rate = np.zeros_like(amplitude), np.zeros_like(amplitude)
    facade = np.full(amplitude.shape, DIRECT, dtype=np.int64)
    amplitude[:, 0] = direct
    if reflections is None or not len(reflections.satellite):
        return Paths(amplitude[:, :1], excess[:, :1], rate[:, :1], facade[:, :1])
    order = np.lexsort((-reflections.amplitude, reflections.satellite))
    satellite = reflections.satellite[order]
    rank = 1 + np.arange(len(order)) - np.searchsorted(satellite, satellite)
    kept = rank <= MAX_REFLECTIONS
    satellite, rank, order = satellite[kept], rank[kept], order[kept]
    amplitude[satellite, rank] = reflections.amplitude[order]
    excess[satellite, rank] = reflections.excess_m[order]
    rate[satellite, rank] = reflections.excess_rate_mps[order]
    facade[satellite, rank] = reflections.facade[order]
    return Paths(amplitude, excess, rate, facade)
