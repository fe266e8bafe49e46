"""The one way in which loops are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """`function` compiled by numba on its first call and cached on disk.

    It releases the interpreter lock, and a division by zero gives inf or NaN as in numpy.
    Hand it arrays of one's own (contiguous, writable): every other kind of array would be
    compiled once more. The cache of a kernel notices changes of its own file only; the
    runtime therefore keeps a folder per version of the sources (services/runtime/state_dir.py).
    """
    return cast("F", numba.njit(cache=True, nogil=True, error_model="numpy")(function))


_INNER: Final[dict[str, Any]] = {"nogil": True, "error_model": "numpy", "no_cpython_wrapper": True}


def inner_kernel(function: F) -> F:
    """As `kernel`, for functions that only kernels call: without the door from Python, which takes long to compile.

    Called from Python it raises TypeError. It is not cached by itself: the kernels that call it hold its code.
    """
    return cast("F", numba.njit(**_INNER)(function))


_SUMMING: Final[dict[str, Any]] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"reassoc", "contract", "nsz"},
}


def summing_kernel(function: F) -> F:
    """As `kernel`, for long sums of products: the order of additions is the compiler's, who may then use vectors.

    Infinities and NaN keep their meaning. Two machines may differ in the last bit.
    """
    return cast("F", numba.njit(**_SUMMING)(function))
