"""The channel from known chips, by least squares: two chip-spaced responses, one per half chip.

Model, per half chip p = 0, 1:  z[2 k + p] = sum over j < TAPS of h[p, j] s[k - j + LEAD] + noise.
The chips s are real and common to both halves, so one small real normal matrix serves both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.burst_sums import add_normal_equations

LEAD = 3
"""Chips by which the response may begin before the nominal place of its chip."""
TAPS = 12
"""Chips that the response may last in all; fewer than the code length, as Arai et al.'s training demands."""
RIDGE = 1e-3
"""Added to the normal matrix, relative to its mean diagonal: keeps directions that the chips hardly excite at zero."""


class NormalEquations:
    """Sums of a least-squares problem, which may be faded and continued: chips and both halves of the samples."""

    def __init__(self, taps: int = TAPS) -> None:
        """Nothing known yet."""
        self.matrix = np.zeros((taps, taps))
        self.right = np.zeros((taps, 2), np.complex128)
        self.energy = 0.0
        self.rows = 0.0

    def fade(self, factor: float) -> None:
        """Let the past count `factor` times as much."""
        self.matrix *= factor
        self.right *= factor
        self.energy *= factor
        self.rows *= factor

    def add(self, regressors: NDArray[np.float64], observed: NDArray[np.complex128]) -> None:
        """Take rows: `regressors` of shape (n, taps), `observed` of shape (n, 2)."""
        self.matrix += regressors.T @ regressors
        self.right += regressors.T @ observed
        self.energy += float(np.sum(np.abs(observed) ** 2))
        self.rows += len(regressors)

    def add_burst(self, chips: NDArray[np.float64], samples: NDArray[np.complex128]) -> None:
        """Take all rows of a burst: its chips, and its samples from LEAD chips before the first on."""
        taps = len(self.matrix)
        self.energy += add_normal_equations(chips, samples, LEAD + first_row(taps), self.matrix, self.right)
        self.rows += len(chips) - taps + 1

    def solve(self, spread: float = 0.0) -> NDArray[np.complex128]:
        """The response, shape (2, taps).

        `spread` > 0 holds down taps away from the strongest path: what the chips do not excite, a short response
        interpolates over frequency.
        """
        size = len(self.matrix)
        level = float(np.trace(self.matrix)) / size + 1e-30
        away = (np.arange(size) - LEAD - 0.5) / size
        weight = level * (RIDGE + spread * away**2)
        return np.asarray(np.linalg.solve(self.matrix + np.diag(weight), self.right).T, np.complex128)

    def misfit(self, taps: NDArray[np.complex128]) -> float:
        """Share of the samples' energy that the response does not explain."""
        explained = 2.0 * float(np.sum(np.conj(taps.T) * self.right).real)
        fitted = float(np.sum((taps @ self.matrix) * np.conj(taps)).real)
        return (self.energy - explained + fitted) / (self.energy + 1e-30)

    def copy(self) -> NormalEquations:
        """An independent copy."""
        other = NormalEquations(len(self.matrix))
        other.matrix, other.right = self.matrix.copy(), self.right.copy()
        other.energy, other.rows = self.energy, self.rows
        return other


def rows_of(chips: NDArray[np.float64], taps: int = TAPS) -> NDArray[np.float64]:
    """Regressors s[k + LEAD - j], j = 0 … taps - 1, for every k whose chips are all given.

    Row 0 belongs to chip `first_row(taps)`; the last row to chip len(chips) - 1 - LEAD.
    """
    return np.lib.stride_tricks.sliding_window_view(chips, taps)[:, ::-1]


def first_row(taps: int = TAPS) -> int:
    """Number of the chip to which row 0 of `rows_of` belongs."""
    return taps - 1 - LEAD


def observed_rows(samples: NDArray[np.complex128], chip_count: int, taps: int = TAPS) -> NDArray[np.complex128]:
    """Samples beside the rows of `rows_of`, shape (n, 2); `samples` begin LEAD chips before the first chip."""
    pairs = samples[: len(samples) // 2 * 2].reshape(-1, 2)
    begin = LEAD + first_row(taps)
    return np.asarray(pairs[begin : begin + chip_count - taps + 1], np.complex128)


def delay_and_add(values: NDArray[np.float64] | NDArray[np.complex128]) -> NDArray[np.complex128]:
    """v[k] + v[k-1] along the first axis: cancels a constant CH1 on row 2 (Arai et al., section 2)."""
    return np.asarray(values[1:] + values[:-1], np.complex128)


def response(taps: NDArray[np.complex128], chips: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Samples that chips cause, beginning LEAD chips before the first, shape (2 (chips + taps - 1),)."""
    found = np.empty((len(chips) + taps.shape[1] - 1, 2), np.complex128)
    for half in range(2):
        found[:, half] = np.convolve(chips, taps[half])
    return found.ravel()
