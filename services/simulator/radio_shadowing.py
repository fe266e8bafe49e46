"""Shadows along a line: what stands beside it is there on every pass."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.simulator.radio_draws import normals

Floats = NDArray[np.float64]

KNOTS_M: Final = 100.0
PADDING: Final = 12.0
"""Correlation lengths after which the ends of a shadow no longer know of each other: e^-12."""


def shadow(of: int, count: int, step_m: float, correlation_m: float) -> Floats:
    """Normal values of unit variance at `count` places `step_m` apart, alike by exp(-distance / correlation_m).

    Gudmundson 1991: a first-order process, here drawn through its spectrum on a circle longer than the line. The values
    belong to the stream `of`.
    """
    around = count + int(PADDING * correlation_m / step_m) + 1
    white = np.fft.rfft(normals(of, np.arange(around)))
    alike = np.exp(-step_m / correlation_m)
    turn = 2.0 * np.pi * np.arange(len(white)) / around
    density = (1.0 - alike**2) / (1.0 + alike**2 - 2.0 * alike * np.cos(turn))
    return np.asarray(np.fft.irfft(white * np.sqrt(density), around)[:count])


def passing(of: int, axis_m: Floats) -> Floats:
    """Normal values of unit variance at places, alike over about KNOTS_M; anew for every stream."""
    place = np.maximum(axis_m, 0.0) / KNOTS_M
    knot = place.astype(np.int64)
    share = place - knot
    left, right = normals(of, knot), normals(of, knot + 1)
    return np.asarray(((1.0 - share) * left + share * right) / np.hypot(1.0 - share, share))
