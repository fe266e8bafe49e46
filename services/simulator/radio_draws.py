"""Random numbers by name and number, not by order: the same draw whoever asks first, and however often.

SplitMix64 (Steele, Lea, Flood 2014) as a function of a stream and an index; normal values by Box and Muller.
A pass can thus be cut anywhere, live or in files, and still be the same pass.
"""

from __future__ import annotations

from typing import Final
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_GOLDEN: Final = 0x9E3779B97F4A7C15
_MASK: Final = (1 << 64) - 1


def stream(*names: int | str) -> int:
    """A stream of draws for what the names say; others are independent of it.

    >>> stream(1, "R01") == stream(1, "R01"), stream(1, "R01") == stream(1, "R02")
    (True, False)
    """
    state = 0
    for name in names:
        number = crc32(name.encode()) if isinstance(name, str) else name
        state = int(_mixed(np.array([(state + (number + 1) * _GOLDEN) & _MASK], np.uint64))[0])
    return state


def uniforms(of: int, index: Indices) -> Floats:
    """Draws in [0, 1) of a stream at indices of any shape."""
    offsets = index.astype(np.uint64) * np.uint64(_GOLDEN)
    return np.asarray((_mixed(offsets + np.uint64(of)) >> np.uint64(11)) * 2.0**-53)


def normals(of: int, index: Indices) -> Floats:
    """Standard normal draws of a stream at indices of any shape."""
    return np.asarray(complex_normals(of, index).real * np.sqrt(2.0))


def complex_normals(of: int, index: Indices) -> NDArray[np.complex128]:
    """Circular complex normal draws of mean power 1."""
    radius = np.sqrt(-np.log1p(-uniforms(of, 2 * index)))
    return np.asarray(radius * np.exp(2j * np.pi * uniforms(of, 2 * index + 1)))


def _mixed(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """The finaliser of SplitMix64."""
    mixed = (values ^ (values >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(mixed ^ (mixed >> np.uint64(31)))
