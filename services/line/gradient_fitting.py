"""Gradients from heights: a broken line of few pieces that stays near them (Ramer 1972, Douglas and Peucker 1973)."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.line import Gradient

Floats = NDArray[np.float64]

HEIGHT_TOLERANCE_M: Final = 1.0
"""Pieces stay this near to the heights: what barometers and maps are good for."""
STEEPEST_PERMILLE: Final = 150.0


def gradients_of(axis_m: Floats, height_m: Floats, tolerance_m: float = HEIGHT_TOLERANCE_M) -> tuple[Gradient, ...]:
    """Gradients of heights (n,) at rising places (n,); n of at least 2.

    >>> found = gradients_of(np.array([0.0, 500.0, 1000.0]), np.array([10.0, 10.0, 20.0]))
    >>> [(one.axis_m, one.permille) for one in found]
    [(0.0, 0.0), (500.0, 20.0)]
    """
    kept = simplified(axis_m, height_m, tolerance_m)
    rise = np.diff(height_m[kept]) / np.maximum(np.diff(axis_m[kept]), 1e-9) * 1000.0
    return tuple(
        Gradient(
            axis_m=round(float(axis_m[kept[k]]), 3),
            permille=round(float(np.clip(rise[k], -STEEPEST_PERMILLE, STEEPEST_PERMILLE)), 2),
        )
        for k in range(len(kept) - 1)
    )


def simplified(x: Floats, y: Floats, tolerance: float) -> list[int]:
    """Indices of the points, ends included, between which straight lines stay within `tolerance` of every `y`."""
    kept = {0, len(x) - 1}
    open_pieces = [(0, len(x) - 1)]
    while open_pieces:
        first, last = open_pieces.pop()
        if last - first < 2:  # noqa: PLR2004 - nothing between
            continue
        inner = slice(first + 1, last)
        off = np.abs(y[inner] - np.interp(x[inner], x[[first, last]], y[[first, last]]))
        if float(off.max()) > tolerance:
            middle = first + 1 + int(off.argmax())
            kept.add(middle)
            open_pieces += [(first, middle), (middle, last)]
    return sorted(kept)
