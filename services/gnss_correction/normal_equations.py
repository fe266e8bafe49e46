"""Small symmetric positive definite systems, solved inside kernels without allocating."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from services.numerics.kernel import kernel

SMALLEST_PIVOT: Final = 1e-10
"""A pivot this small against its diagonal element means that the unknown is not determined."""


@kernel
def factorise(matrix: Any, size: int) -> bool:  # noqa: ANN401 - numba array
    """Cholesky factor into the lower triangle of `matrix[:size, :size]`; False when it is singular."""
    for j in range(size):
        whole = matrix[j, j]
        pivot = whole
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        if not pivot > SMALLEST_PIVOT * whole:
            return False
        root = np.sqrt(pivot)
        matrix[j, j] = root
        for i in range(j + 1, size):
            value = matrix[i, j]
            for k in range(j):
                value -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = value / root
    return True


@kernel
def solve_factorised(factor: Any, size: int, vector: Any) -> None:  # noqa: ANN401 - numba array
    """Solution of L Lᵀ x = vector, in place of `vector[:size]`."""
    for i in range(size):
        value = vector[i]
        for k in range(i):
            value -= factor[i, k] * vector[k]
        vector[i] = value / factor[i, i]
    for i in range(size - 1, -1, -1):
        value = vector[i]
        for k in range(i + 1, size):
            value -= factor[k, i] * vector[k]
        vector[i] = value / factor[i, i]


@kernel
def spread_of_position(factor: Any, size: int, up: Any, column: Any) -> tuple[float, float]:  # noqa: ANN401 - numba array
    """Horizontal and whole variance of the first three unknowns, from a factor of the normal matrix.

    `up` (3,) is the local vertical; `column` is scratch of at least `size`.
    """
    whole, vertical = 0.0, 0.0
    for j in range(3):
        for i in range(size):
            column[i] = 1.0 if i == j else 0.0
        solve_factorised(factor, size, column)
        whole += column[j]
        vertical += up[j] * (up[0] * column[0] + up[1] * column[1] + up[2] * column[2])
    return whole - vertical, whole
