"""Least mean squares, complex: the paper's algorithm (Arai et al., section 2).

e[k] = t[k] - sum w[j] x[s k + j],    w[j] += mu e[k] conj(x[s k + j])
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import summing_kernel

REFRESH = 4096
"""Updates after which the running input power is summed anew, against rounding."""


@dataclass(frozen=True, slots=True)
class Adapted:
    """What an adaptive filter ended with."""

    taps: NDArray[np.complex128]
    """The last coefficients, as many as it began with."""
    best: NDArray[np.complex128]
    """Those at the smallest smoothed square error."""
    error: NDArray[np.complex128]
    """Before each update."""


@summing_kernel
def adapt(
    inputs_re: NDArray[np.float64],
    inputs_im: NDArray[np.float64],
    target_re: NDArray[np.float64],
    target_im: NDArray[np.float64],
    taps: NDArray[np.float64],
    best: NDArray[np.float64],
    error: NDArray[np.float64],
    step: float,
    stride: int,
    smoothing: float,
    keep: float,
    normalised: bool,  # noqa: FBT001 - numba takes no keyword-only arguments
) -> None:
    """Run over all targets; `taps`, `best` of shape (2, taps) and `error` (2, n) are written: real and imaginary rows.

    One pass serves both the update with the present input and the sum over the next one. `keep` multiplies the
    taps at every update (leakage). The best taps are sought once the smoothing has seen 1/`smoothing` errors.
    """
    count, length = error.shape[1], taps.shape[1]
    wr, wi = taps[0], taps[1]
    power, out_re, out_im = 1e-30, 0.0, 0.0
    for j in range(length):
        power += inputs_re[j] ** 2 + inputs_im[j] ** 2
        out_re += wr[j] * inputs_re[j] - wi[j] * inputs_im[j]
        out_im += wr[j] * inputs_im[j] + wi[j] * inputs_re[j]
    smooth, least, settle, refresh = 0.0, np.inf, int(1.0 / smoothing), REFRESH
    ur, ui = inputs_re[:length], inputs_im[:length]
    for k in range(count):
        e_re, e_im = target_re[k] - out_re, target_im[k] - out_im
        error[0, k], error[1, k] = e_re, e_im
        if k < settle:
            smooth += (e_re * e_re + e_im * e_im - smooth) / (k + 1)
        else:
            smooth += (e_re * e_re + e_im * e_im - smooth) * smoothing
            if smooth < least:
                least = smooth
                for j in range(length):
                    best[0, j], best[1, j] = wr[j], wi[j]
        gain = step / power if normalised else step
        g_re, g_im = gain * e_re, gain * e_im
        ahead = (k + 1) * stride if k + 1 < count else k * stride
        vr, vi = inputs_re[ahead : ahead + length], inputs_im[ahead : ahead + length]
        out_re, out_im = 0.0, 0.0
        for j in range(length):
            new_re = keep * wr[j] + g_re * ur[j] + g_im * ui[j]
            new_im = keep * wi[j] + g_im * ur[j] - g_re * ui[j]
            wr[j], wi[j] = new_re, new_im
            out_re += new_re * vr[j] - new_im * vi[j]
            out_im += new_re * vi[j] + new_im * vr[j]
        for j in range(stride):
            entering, leaving = length - stride + j, j
            power += vr[entering] ** 2 + vi[entering] ** 2 - ur[leaving] ** 2 - ui[leaving] ** 2
        ur, ui = vr, vi
        refresh -= 1
        if refresh == 0:
            refresh, power = REFRESH, 1e-30
            for j in range(length):
                power += vr[j] ** 2 + vi[j] ** 2


def run_adaptive(
    inputs: NDArray[np.complex128],
    target: NDArray[np.complex128],
    start: NDArray[np.complex128],
    *,
    step: float,
    stride: int,
    normalised: bool,
    smoothing: float = 1.0 / 64.0,
    leakage: float = 0.0,
) -> Adapted:
    """Adapt `start` to give target[k] from inputs[stride k : stride k + taps].

    Raises ValueError when the inputs are too short for the targets.
    """
    needed = stride * (len(target) - 1) + len(start)
    if len(inputs) < needed or stride > len(start):
        msg = f"{len(inputs)} inputs for {len(target)} targets with {len(start)} taps: {needed} are needed"
        raise ValueError(msg)
    taps = np.ascontiguousarray([start.real, start.imag])
    best, error = taps.copy(), np.empty((2, len(target)))
    adapt(
        np.ascontiguousarray(inputs.real),
        np.ascontiguousarray(inputs.imag),
        np.ascontiguousarray(target.real),
        np.ascontiguousarray(target.imag),
        taps,
        best,
        error,
        step,
        stride,
        smoothing,
        1.0 - leakage,
        normalised,
    )
    return Adapted(taps[0] + 1j * taps[1], best[0] + 1j * best[1], error[0] + 1j * error[1])


def lms(
    inputs: NDArray[np.complex128],
    target: NDArray[np.complex128],
    start: NDArray[np.complex128],
    step: float,
    stride: int = 1,
) -> Adapted:
    """LMS with a step relative to 1 / (taps x mean input power), at which it would become unstable near 2."""
    power = float(np.mean(np.abs(inputs) ** 2)) * len(start) + 1e-30
    return run_adaptive(inputs, target, start, step=step / power, stride=stride, normalised=False)
