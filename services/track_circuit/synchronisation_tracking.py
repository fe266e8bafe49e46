"""Carrier and chip clock followed from burst to burst by what happens to the channel's response."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.channel_estimate import NormalEquations

PHASE_GAIN, FREQUENCY_GAIN = 0.6, 0.25
DELAY_GAIN, CLOCK_GAIN = 0.5, 0.15
"""Second-order loops, per burst: damping near 1 with these."""
REFERENCE_GAIN = 0.1
"""Share of each burst's response that enters the reference."""


@dataclass(frozen=True, slots=True)
class Drift:
    """What a burst says of the loops' errors."""

    phase_turns: float
    delay_chips: float


def burst_response(samples: NDArray[np.complex128], chips: NDArray[np.float64]) -> NDArray[np.complex128]:
    """The channel's response in one burst with all chips known or decided, shape (2, taps)."""
    sums = NormalEquations()
    sums.add_burst(chips, samples)
    return sums.solve()


def _slope(taps: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Derivative of the response by time in chips, through its spectrum at two samples per chip."""
    interleaved = taps.T.ravel()
    frequency = np.fft.fftfreq(len(interleaved), 0.5)
    return np.asarray(np.fft.ifft(2j * np.pi * frequency * np.fft.fft(interleaved)), np.complex128)


class ResponseTracker:
    """Compares each burst's response with the slowly renewed reference."""

    def __init__(self) -> None:
        """Without a reference; the first burst becomes it."""
        self._reference: NDArray[np.complex128] | None = None

    def step(self, taps: NDArray[np.complex128]) -> Drift:
        """Phase and delay of `taps` against the reference, which then moves a little towards them."""
        if self._reference is None:
            self._reference = taps.copy()
            return Drift(0.0, 0.0)
        reference = self._reference
        phase = float(np.angle(np.vdot(reference, taps)))
        aligned = taps * np.exp(-1j * phase)
        gain = float(np.vdot(reference, aligned).real) / (float(np.vdot(reference, reference).real) + 1e-30)
        slope = gain * _slope(reference)
        change = (aligned - gain * reference).T.ravel()
        delay = -float(np.vdot(slope, change).real) / (float(np.vdot(slope, slope).real) + 1e-30)
        self._reference = reference + REFERENCE_GAIN * (aligned - reference)
        return Drift(phase / (2.0 * np.pi), float(np.clip(delay, -0.5, 0.5)))
