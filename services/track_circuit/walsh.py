"""Walsh-Hadamard codes and what makes one fit for training."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def hadamard(length: int) -> NDArray[np.float64]:
    """The Hadamard matrix by Sylvester's construction, shape (length, length), entries +1 and -1.

    Raises ValueError unless `length` is a power of two.
    """
    if length < 1 or length & (length - 1):
        msg = f"Walsh-Hadamard codes have a power of two as length, not {length}"
        raise ValueError(msg)
    matrix = np.ones((1, 1))
    while len(matrix) < length:
        matrix = np.block([[matrix, matrix], [matrix, -matrix]])
    return matrix


def code(length: int, row: int) -> NDArray[np.float64]:
    """Row `row`, counted from 1, of the Hadamard matrix; row 2 alternates.

    >>> code(4, 2).tolist()
    [1.0, -1.0, 1.0, -1.0]
    """
    return np.array(hadamard(length)[row - 1], np.float64)
