"""Recursive least squares, complex, with exponential forgetting (Haykin, Adaptive Filter Theory, chapter 10).

u = P conj(x),  g = 1 / (lambda + x.u),  w += g e u,  P = (P - g u u^H) / lambda
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import summing_kernel
from services.track_circuit.lms import Adapted

DELTA = 0.01
"""Start of the inverse correlation: P = I / (DELTA x input power)."""
RESYMMETRISE = 32
"""Updates after which P is made Hermitian again: rounding would tear it apart as 1/lambda^n."""


@summing_kernel
def rls_run(
    inputs_re: NDArray[np.float64],
    inputs_im: NDArray[np.float64],
    target_re: NDArray[np.float64],
    target_im: NDArray[np.float64],
    taps: NDArray[np.float64],
    inverse: NDArray[np.float64],
    error: NDArray[np.float64],
    forgetting: float,
    stride: int,
) -> None:
    """Run over all targets; `taps` (2, m), `inverse` (2, m, m) and `error` (2, n) are written.

    The downdate of P by the last input and its product with the next one share a pass over P.
    """
    length = taps.shape[1]
    wr, wi, matrix_re, matrix_im = taps[0], taps[1], inverse[0], inverse[1]
    ur, ui = np.zeros(length), np.zeros(length)
    nr, ni = np.zeros(length), np.zeros(length)
    gain, grow = 0.0, 1.0
    for k in range(error.shape[1] + 1):
        last = k == error.shape[1]
        at = (k - 1 if last else k) * stride
        xr, xi = inputs_re[at : at + length], inputs_im[at : at + length]
        nr[:] = 0.0
        ni[:] = 0.0
        for j in range(length):
            c, d, a, b = xr[j], -xi[j], ur[j] * gain, ui[j] * gain
            row_re, row_im = matrix_re[j], matrix_im[j]
            for i in range(length):
                p = grow * row_re[i] - (a * ur[i] + b * ui[i])
                q = grow * row_im[i] - (b * ur[i] - a * ui[i])
                row_re[i], row_im[i] = p, q
                nr[i] += p * c + q * d
                ni[i] += p * d - q * c
        if last:
            return
        ur, nr = nr, ur
        ui, ni = ni, ui
        if k % RESYMMETRISE == RESYMMETRISE - 1:
            for j in range(length):
                matrix_im[j, j] = 0.0
                for i in range(j):
                    matrix_re[i, j] = matrix_re[j, i]
                    matrix_im[i, j] = -matrix_im[j, i]
        denominator, out_re, out_im = forgetting, 0.0, 0.0
        for i in range(length):
            denominator += ur[i] * xr[i] - ui[i] * xi[i]
            out_re += wr[i] * xr[i] - wi[i] * xi[i]
            out_im += wr[i] * xi[i] + wi[i] * xr[i]
        e_re, e_im = target_re[k] - out_re, target_im[k] - out_im
        error[0, k], error[1, k] = e_re, e_im
        gain = 1.0 / denominator
        g_re, g_im = gain * e_re, gain * e_im
        for i in range(length):
            wr[i] += ur[i] * g_re - ui[i] * g_im
            wi[i] += ur[i] * g_im + ui[i] * g_re
        grow = 1.0 / forgetting
        gain *= grow


class Rls:
    """A filter that remembers its inverse correlation from call to call."""

    def __init__(self, start: NDArray[np.complex128], forgetting: float = 1.0, delta: float = DELTA) -> None:
        """Begin at `start`; the inverse correlation is set with the first inputs."""
        self._taps = np.ascontiguousarray([start.real, start.imag])
        self._inverse: NDArray[np.float64] | None = None
        self._forgetting = forgetting
        self._delta = delta

    def run(self, inputs: NDArray[np.complex128], target: NDArray[np.complex128], stride: int = 1) -> Adapted:
        """Adapt on; `best` equals `taps`, for the last are the best over everything heard."""
        if self._inverse is None:
            power = float(np.mean(np.abs(inputs) ** 2)) + 1e-30
            self._inverse = np.zeros((2, self._taps.shape[1], self._taps.shape[1]))
            self._inverse[0] = np.eye(self._taps.shape[1]) / (self._delta * power)
        error = np.empty((2, len(target)))
        rls_run(
            np.ascontiguousarray(inputs.real),
            np.ascontiguousarray(inputs.imag),
            np.ascontiguousarray(target.real),
            np.ascontiguousarray(target.imag),
            self._taps,
            self._inverse,
            error,
            self._forgetting,
            stride,
        )
        taps = self._taps[0] + 1j * self._taps[1]
        return Adapted(taps, taps.copy(), error[0] + 1j * error[1])
