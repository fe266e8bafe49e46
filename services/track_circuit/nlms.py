"""Normalised least mean squares: the step is divided by the power in the filter, so that 0 < mu < 2 is stable."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.lms import Adapted, run_adaptive


def nlms(
    inputs: NDArray[np.complex128],
    target: NDArray[np.complex128],
    start: NDArray[np.complex128],
    step: float,
    stride: int = 1,
    leakage: float = 0.0,
) -> Adapted:
    """Adaptation by w += mu e conj(x) / |x|^2; `leakage` pulls the taps to zero by that share at every update."""
    return run_adaptive(inputs, target, start, step=step, stride=stride, normalised=True, leakage=leakage)
