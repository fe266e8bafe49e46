"""Batch least squares for equaliser coefficients."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

RIDGE = 1e-3
"""Added to the normal matrix relative to its mean diagonal: the half of the band without signal stays at rest."""


def windows(inputs: NDArray[np.complex128], count: int, taps: int, stride: int) -> NDArray[np.complex128]:
    """Rows inputs[stride k : stride k + taps], shape (count, taps)."""
    view = np.lib.stride_tricks.sliding_window_view(inputs, taps)[: stride * (count - 1) + 1 : stride]
    return np.asarray(view, np.complex128)


def least_squares(
    inputs: NDArray[np.complex128], target: NDArray[np.complex128], taps: int, stride: int, ridge: float = RIDGE
) -> NDArray[np.complex128]:
    """Coefficients w with the least sum |target[k] - sum w[j] inputs[stride k + j]|^2."""
    rows = windows(inputs, len(target), taps, stride)
    normal = rows.conj().T @ rows
    weight = ridge * float(np.trace(normal).real) / taps + 1e-30
    return np.asarray(np.linalg.solve(normal + weight * np.eye(taps), rows.conj().T @ target), np.complex128)
