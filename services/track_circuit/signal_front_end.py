"""From real samples to complex baseband at two samples per chip, at any clock and carrier."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import summing_kernel
from services.track_circuit.modulate import root_raised_cosine

ROLL_OFF = 0.25
"""Of the low-pass: flat up to 0.75 of the chip rate, where rectangular chips have almost all of their energy."""
SPAN = 8
"""Reach of the low-pass to either side, in output samples (half chips)."""
PHASES = 512
"""Positions between two input samples at which the low-pass is kept; rounding to them leaves errors below -60 dB."""

ANGLES = 64
"""Samples for which one coarse angle of the carrier serves; finer ones come from a table."""


@summing_kernel
def _mix_and_filter(
    samples: NDArray[np.float64],
    table: NDArray[np.float64],
    reach: int,
    start: float,
    step: float,
    cycles_per_sample: float,
    phase_turns: float,
    found: NDArray[np.complex128],
) -> None:
    """found[n] = sum over i of 2 x[i] exp(-2 pi j (f i + phase)) h(start + n step - i); outside is silence."""
    first = int(np.floor(start)) - reach
    last = int(np.floor(start + step * (len(found) - 1))) + reach + 1
    mixed = np.zeros(last - first + 1, np.complex128)
    end = min(last + 1, len(samples))
    fine = np.empty(ANGLES, np.complex128)
    for k in range(ANGLES):
        angle = -2.0 * np.pi * cycles_per_sample * k
        fine[k] = 2.0 * (np.cos(angle) + 1j * np.sin(angle))
    for begin in range(max(first, 0), end, ANGLES):
        turns = cycles_per_sample * begin + phase_turns
        angle = -2.0 * np.pi * (turns - np.floor(turns))
        coarse = np.cos(angle) + 1j * np.sin(angle)
        for i in range(begin, min(begin + ANGLES, end)):
            mixed[i - first] = samples[i] * (coarse * fine[i - begin])
    phases = table.shape[0]
    width = table.shape[1]
    for n in range(len(found)):
        at = start + step * n
        whole = int(np.floor(at))
        phase = int((at - whole) * phases + 0.5)
        if phase == phases:
            phase = 0
            whole += 1
        near = whole - reach - first
        real = 0.0
        imaginary = 0.0
        for k in range(width):
            if near + k < len(mixed):
                value = mixed[near + k]
                real += table[phase, k] * value.real
                imaginary += table[phase, k] * value.imag
        found[n] = real + 1j * imaginary


class FrontEnd:
    """The receiver's input filter for one sample rate and chip rate.

    A root-raised-cosine at two samples per chip: its power response folds to a constant, so white noise stays
    white at the output, which the matched filter and the Viterbi search behind it rely on.
    Raises ValueError when the sample rate cannot carry the chip rate.
    """

    def __init__(self, sample_rate_hz: float, chip_rate_hz: float) -> None:
        """Tabulate the filter."""
        half_chip = sample_rate_hz / (2.0 * chip_rate_hz)
        if half_chip < 1.0:
            msg = f"{sample_rate_hz:g} samples/s are fewer than two per chip of {chip_rate_hz:g} chips/s"
            raise ValueError(msg)
        self.sample_rate_hz = sample_rate_hz
        self._reach = int(np.ceil(SPAN * half_chip))
        offsets = np.arange(-self._reach, self._reach + 1)
        distance = np.arange(PHASES)[:, None] / PHASES - offsets
        table = root_raised_cosine(distance / half_chip, ROLL_OFF)
        self._table = np.ascontiguousarray(table / table.sum(axis=1, keepdims=True))

    @property
    def reach(self) -> int:
        """Input samples needed to either side of an output."""
        return self._reach + 1

    def baseband(
        self, samples: NDArray[np.float64], start: float, step: float, count: int, carrier_hz: float, phase_turns: float
    ) -> NDArray[np.complex128]:
        """`count` baseband samples at positions start, start + step, … counted in input samples.

        `phase_turns` is the carrier's phase at input sample 0 in turns. Positions beyond the samples see silence.
        """
        found = np.empty(count, np.complex128)
        _mix_and_filter(
            samples, self._table, self._reach, start, step, carrier_hz / self.sample_rate_hz, phase_turns, found
        )
        return found
