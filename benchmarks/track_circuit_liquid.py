"""liquid-dsp's adaptive filters as a peer, where the library is installed (Debian: libliquid1)."""

from __future__ import annotations

import ctypes
import ctypes.util
import time
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

STEP = 0.1


def liquid() -> ctypes.CDLL | None:
    """The library, or None where there is none."""
    for name in (ctypes.util.find_library("liquid"), "libliquid.so.1", "libliquid.so"):
        if name is not None:
            with suppress(OSError):
                return ctypes.CDLL(name)
    return None


def trained_per_s(
    library: ctypes.CDLL, kind: str, inputs: NDArray[np.complex128], target: NDArray[np.complex128], taps: int
) -> float:
    """Samples per second of processor time of `eqlms_cccf` or `eqrls_cccf`, best of three runs over all targets.

    Whole blocks are given over, so that the way from Python into C does not count. Its numbers are single precision.
    """
    create, train, destroy = (getattr(library, f"{kind}_{what}") for what in ("create", "train", "destroy"))
    create.restype, create.argtypes = ctypes.c_void_p, [ctypes.c_void_p, ctypes.c_uint]
    train.restype, train.argtypes = ctypes.c_int, [ctypes.c_void_p] * 4 + [ctypes.c_uint]
    destroy.restype, destroy.argtypes = ctypes.c_int, [ctypes.c_void_p]
    bandwidth = getattr(library, f"{kind}_set_bw")
    bandwidth.restype, bandwidth.argtypes = ctypes.c_int, [ctypes.c_void_p, ctypes.c_float]
    count = len(target)
    x, d = (np.ascontiguousarray(one[:count], np.complex64) for one in (inputs, target))
    found = []
    for _ in range(3):
        weights = np.zeros(taps, np.complex64)
        filter_of = create(None, taps)
        bandwidth(filter_of, STEP if kind == "eqlms_cccf" else 0.999)
        started = time.thread_time()
        train(filter_of, weights.ctypes.data, x.ctypes.data, d.ctypes.data, count)
        found.append(time.thread_time() - started)
        destroy(filter_of)
        if not np.any(weights):
            msg = f"liquid-dsp's {kind}_train did nothing"
            raise RuntimeError(msg)
    return count / min(found)
