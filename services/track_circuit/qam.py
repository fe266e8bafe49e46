"""Quadrature amplitude modulation with Gray labels: 4, 16 or 64 points of unit mean power."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def levels(order: int) -> NDArray[np.float64]:
    """Amplitudes on I and on Q, ascending, such that all points together have unit mean power.

    Raises ValueError for orders other than 4, 16 and 64.
    """
    if order not in (4, 16, 64):
        msg = f"QAM of order {order}: there are 4, 16 and 64"
        raise ValueError(msg)
    side = math.isqrt(order)
    plain = 2.0 * np.arange(side) - (side - 1)
    return np.asarray(plain / np.sqrt(2.0 * np.mean(plain**2)), np.float64)


def bits_per_symbol(order: int) -> int:
    """Bits that one point carries."""
    return order.bit_length() - 1


def _gray(side: int) -> NDArray[np.int64]:
    """Label of each level: neighbours differ in one bit."""
    index = np.arange(side)
    return np.asarray(index ^ (index >> 1), np.int64)


def qam_points(bits: NDArray[np.int8], order: int) -> NDArray[np.complex128]:
    """Points of bits; the first half of a symbol's bits chooses I, the second Q, highest bit first."""
    half = bits_per_symbol(order) // 2
    weights = 1 << np.arange(half)[::-1]
    labels = bits.astype(np.int64).reshape(-1, 2, half) @ weights
    level = np.empty(1 << half)
    level[_gray(1 << half)] = levels(order)
    chosen = level[labels]
    return np.asarray(chosen[:, 0] + 1j * chosen[:, 1], np.complex128)


def nearest(points: NDArray[np.complex128], order: int) -> NDArray[np.complex128]:
    """The nearest point of the constellation to each."""
    grid = levels(order)
    return np.asarray(grid[_index(points.real, grid)] + 1j * grid[_index(points.imag, grid)], np.complex128)


def _index(values: NDArray[np.float64], grid: NDArray[np.float64]) -> NDArray[np.int64]:
    step = grid[1] - grid[0]
    return np.asarray(np.clip(np.rint((values - grid[0]) / step), 0, len(grid) - 1), np.int64)


def qam_bits(points: NDArray[np.complex128], order: int) -> NDArray[np.int8]:
    """Bits of the nearest points."""
    half = bits_per_symbol(order) // 2
    grid, gray = levels(order), _gray(1 << half)
    labels = np.stack([gray[_index(points.real, grid)], gray[_index(points.imag, grid)]], axis=1)
    shifts = np.arange(half)[::-1]
    return ((labels[:, :, None] >> shifts) & 1).astype(np.int8).ravel()


def theoretical_ber(order: int, snr_per_bit_db: float) -> float:
    """Bit error rate in white noise with Gray labels, nearest neighbours only (Proakis, section 4.3)."""
    side, bits = math.isqrt(order), bits_per_symbol(order)
    ratio = 10.0 ** (snr_per_bit_db / 10.0)
    argument = math.sqrt(3.0 * bits * ratio / (order - 1.0))
    return 4.0 / bits * (1.0 - 1.0 / side) * 0.5 * math.erfc(argument / math.sqrt(2.0))
