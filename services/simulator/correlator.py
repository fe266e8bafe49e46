"""What a receiver's loops make of several copies of one signal: code error, phase error, power.

Code: a coherent early-minus-late discriminator on the triangular correlation of an unfiltered
binary code, R(x) = max(1 - |x|, 0) with x in chips. Path k arrives with amplitude a_k, delay d_k
and phase; after the carrier loop has turned the sum of all paths real, its weight is
w_k = a_k cos(phase_k - phase of the sum), and the loop rests where
    D(x) = sum_k w_k [R(x - d_k + s/2) - R(x - d_k - s/2)]
crosses zero downwards, s being the spacing. D is linear between corners, so the root is exact.
One reflection weaker than the direct path gives the familiar envelope (Van Nee 1993; Braasch 1996;
Kaplan and Hegarty 2017, 9.5): a d cos p / (1 + a cos p) near, a s/2 cos p beyond.
Reflections alone (direct path hidden) put the root at their own delay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Composite:
    """What the loops measure, against the direct path; every column (k,)."""

    code_error_chips: Floats
    carrier_excess_cycles: Floats
    """Excess of the strongest path, plus what the others turn the sum."""
    carrier_rate_hz: Floats
    """How fast that grows."""
    path_rate_hz: Floats
    """How fast the strongest path alone grows."""
    amplitude: Floats
    """Of the sum; 1 for a direct path alone."""


def composite(
    amplitude: Floats,
    delay_chips: Floats,
    phase_cycles: Floats,
    rate_hz: Floats,
    *,
    spacing_chips: float,
    averaging_s: float,
) -> Composite:
    """Response to paths in columns, shape (k, r); unused columns have amplitude 0.

    `phase_cycles` is the path's excess in wavelengths (the half cycle of a reflection included),
    `rate_hz` how fast it grows. What turns against the strongest path within `averaging_s` the
    loops average away (sinc). Each row must hold at least one path with amplitude.
    """
    strongest = amplitude.argmax(axis=1)[:, None]
    at_chips, at_cycles, at_hz = (
        np.take_along_axis(column, strongest, axis=1) for column in (delay_chips, phase_cycles, rate_hz)
    )
    steady = amplitude * np.abs(np.sinc((rate_hz - at_hz) * averaging_s))
    phasors: Complexes = steady * np.exp(-2j * np.pi * (phase_cycles - at_cycles))
    heard = phasors * np.maximum(1 - np.abs(delay_chips - at_chips), 0.0)
    total = heard.sum(axis=1)
    turning = (heard * rate_hz).sum(axis=1)
    weight = (phasors * np.conj(total / np.maximum(np.abs(total), 1e-12))[:, None]).real
    return Composite(
        code_error_chips=_root(weight, delay_chips, at_chips[:, 0], spacing_chips),
        carrier_excess_cycles=at_cycles[:, 0] - np.angle(total) / (2 * np.pi),
        carrier_rate_hz=(turning * np.conj(total)).real / np.maximum(np.abs(total) ** 2, 1e-12),
        path_rate_hz=at_hz[:, 0],
        amplitude=np.abs(total),
    )


def _root(weight: Floats, delay: Floats, start: Floats, spacing: float) -> Floats:
    """Downward zero crossing of the discriminator nearest to `start` (k,); `start` if there is none."""
    half = spacing / 2
    corners = np.array([-half, half, 1 - half, half - 1, 1 + half, -1 - half])
    grid = np.sort((delay[:, :, None] + corners).reshape(len(delay), -1), axis=1)
    apart = grid[:, :, None] - delay[:, None, :]
    early, late = np.maximum(1 - np.abs(apart + half), 0.0), np.maximum(1 - np.abs(apart - half), 0.0)
    value = ((early - late) * weight[:, None, :]).sum(axis=2)
    left, right = value[:, :-1], value[:, 1:]
    down = (left >= 0) & (right < 0)
    drop = np.where(down, left - right, 1.0)
    crossing = grid[:, :-1] + np.diff(grid, axis=1) * left / drop
    distance = np.where(down, np.abs(crossing - start[:, None]), np.inf)
    best = distance.argmin(axis=1)[:, None]
    found = np.take_along_axis(down, best, axis=1)[:, 0]
    return np.where(found, np.take_along_axis(crossing, best, axis=1)[:, 0], start)
