"""Whether a reference station stands where it says, judged by what it corrects.

A station that is elsewhere than it believes gives corrections that are consistent with each other
and carry every receiver off by the same way. But corrections beyond the broadcast models are small
(orbits, clocks, what the models leave of the air), and no such errors of a sky full of satellites
look like a way of tens of metres. Hence the corrections, less what the models explain, are fitted by a
displacement d of the station and a clock per constellation k,

    y_i = -l_i d + c_k(i),

with the weights min(1, H s_i / |residual_i|) of Huber 1964, so that a single bad satellite does not
feign a displacement; l unit vectors towards the satellites. The same is asked at the station,
before it publishes, and at the receiver, before it believes.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Float64s = NDArray[np.float64]
Ints = NDArray[np.int64]

ZENITH_SIGMA_M: Final = 2.0
"""What the broadcast orbits and clocks and the models of the air leave of a satellite overhead, one sigma."""
HUBER: Final = 1.5
ROUNDS: Final = 10
FURTHEST_M: Final = 15.0
"""Horizontal displacement that the air may feign: several times the error of single points under an open sky, and
what is left of it near the maximum of the solar cycle."""
HIGHEST_M: Final = 40.0
"""The same, vertically, where the air shows most."""
LARGEST_RESIDUAL: Final = 6.0
"""Standard deviations from which on a satellite contradicts the others."""


class StationFit(NamedTuple):
    """How well corrections agree with the place of their station."""

    east_north_up_m: Float64s
    """Shape (3,): displacement that explains them best; NaN where too few satellites determine it."""
    residual_m: Float64s
    """Shape (n,): what the displacement and the clocks leave."""
    sigma_m: Float64s
    """Shape (n,): how large that may be."""


def usual_sigma_m(elevation_rad: Float64s) -> Float64s:
    """Standard deviation of a pseudorange against the broadcast models [m], by the slant of the path.

    The thin layer at 350 km gives the slant, 1/sqrt(1 - (0.948 cos el)²) (Klobuchar 1987).
    """
    return np.asarray(ZENITH_SIGMA_M / np.sqrt(1.0 - (0.948 * np.cos(elevation_rad)) ** 2))


def fit_station(line_enu: Float64s, system: Ints, elevation_rad: Float64s, difference_m: Float64s) -> StationFit:
    """Displacement and clocks that explain `difference_m`, measured minus modelled pseudoranges (n,).

    `line_enu` (n, 3) are unit vectors towards the satellites, `system` their constellations. With fewer
    than one satellite beyond the unknowns there is no displacement; residuals are then against the
    median of each constellation.
    """
    sigma_m = usual_sigma_m(elevation_rad)
    systems = np.unique(system)
    clocks = (system[:, None] == systems[None, :]).astype(float)
    if difference_m.size <= 3 + systems.size:
        medians = np.array([np.median(difference_m[system == one]) for one in systems])
        return StationFit(np.full(3, np.nan), difference_m - clocks @ medians, sigma_m)
    design = np.hstack([-line_enu, clocks])
    weight: Float64s = 1.0 / sigma_m
    residual_m: Float64s = difference_m
    solution: Float64s = np.zeros(design.shape[1])
    for _ in range(ROUNDS):
        solution = np.asarray(np.linalg.lstsq(design * weight[:, None], difference_m * weight, rcond=None)[0], float)
        residual_m = np.asarray(difference_m - design @ solution)
        share = HUBER / np.maximum(np.abs(residual_m) / sigma_m, HUBER)
        weight = np.asarray(np.sqrt(share) / sigma_m)
    return StationFit(solution[:3], residual_m, sigma_m)


def displaced(fit: StationFit) -> str:
    """In words how far a station seems to stand from where it says; empty when it stands well enough.

    >>> displaced(StationFit(np.array([60.0, 80.0, 0.0]), np.zeros(5), np.ones(5)))
    'the station seems to stand 100 m off'
    """
    east_m, north_m, up_m = fit.east_north_up_m.tolist()
    across_m = float(np.hypot(east_m, north_m))
    if across_m > FURTHEST_M or abs(up_m) > HIGHEST_M:
        return f"the station seems to stand {np.hypot(across_m, up_m):.0f} m off"
    return ""
