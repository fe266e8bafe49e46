"""Linear receivers: a chip equaliser at two samples per chip, trained on CH2 behind delay-and-add, then despreading.

`lms` is the paper's (Arai et al., section 2): delay-and-add cancels CH1, CH2's chips delayed and added are the
training signal, and the coefficients at the smallest mean square error equalise CH1.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.equaliser_guards import refuse_pilot_training
from services.track_circuit.least_squares import least_squares, windows
from services.track_circuit.lms import Adapted, lms
from services.track_circuit.modulate import spread
from services.track_circuit.nlms import nlms
from services.track_circuit.profile import Profile
from services.track_circuit.receiver import Burst, Reception, StoredTaps
from services.track_circuit.rls import Rls
from services.track_circuit.walsh import code
from services.track_circuit.warm_start import ALIGN_SYMBOLS, STEP, aligned, held

Algorithm = Literal["lms", "nlms", "rls", "least-squares"]
HALF_CHIP_TAPS = 24
"""Of the equaliser: 12 chips, from 3 before the chip to 9 after it."""
STRIDE = 2
"""Inputs per chip."""
LMS_STEP, NLMS_STEP = 0.2, 0.5
FORGETTING = 0.9995
"""Of RLS, per chip: a memory of 125 symbols of 16 chips."""
DECISION_ROUNDS = 2
"""Of batch least squares: with CH1 as decided, if it is not known."""
ERROR_FLOOR = 1e-12


def training_pair(
    samples: NDArray[np.complex128], chips: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Inputs and targets behind delay-and-add; target k belongs to inputs[2 k : 2 k + taps]."""
    return samples[STRIDE:] + samples[:-STRIDE], (chips[1:] + chips[:-1]).astype(np.complex128)


def despread(chips: NDArray[np.complex128], chips_of_code: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Symbols of equalised chips, ±1 without fault."""
    return np.asarray(chips.reshape(-1, len(chips_of_code)) @ chips_of_code / len(chips_of_code), np.complex128)


def per_symbol_db(error: NDArray[np.complex128], length: int) -> NDArray[np.float64]:
    """Mean square error of each symbol's chips in dB."""
    count = len(error) // length
    power = np.mean(np.abs(error[: count * length].reshape(count, length)) ** 2, axis=1)
    return np.asarray(10.0 * np.log10(power + ERROR_FLOOR), np.float64)


def evm_db(points: NDArray[np.complex128]) -> float:
    """Root mean square distance from the decided ±1 in dB."""
    distance = points - np.where(points.real < 0.0, -1.0, 1.0)
    return float(10.0 * np.log10(np.mean(np.abs(distance) ** 2) + ERROR_FLOOR))


class LinearReceiver:
    """One of the linear receivers; keeps its taps from burst to burst."""

    def __init__(
        self, profile: Profile, algorithm: Algorithm, stored: StoredTaps | None = None, taps: int = HALF_CHIP_TAPS
    ) -> None:
        """Begin from zero or from stored taps. Raises ReceiverRefusedError, see equaliser_guards."""
        refuse_pilot_training(profile, taps / STRIDE)
        self.name: Final = algorithm
        self._code1 = code(profile.code_length, profile.ch1_row)
        self._code2 = profile.ch2_amplitude * code(profile.code_length, profile.ch2_row)
        self._taps = np.zeros(taps, np.complex128)
        self._stored = None if stored is None else stored.taps
        self._anchor: NDArray[np.complex128] | None = None
        self._rls: Rls | None = None

    def receive(self, burst: Burst) -> Reception:
        """Train on the burst's pilots (and on CH1 where known), then equalise and despread it."""
        pilot_chips = spread(burst.pilots, self._code2)
        if burst.known is not None and np.all(burst.known != 0.0):
            chips = pilot_chips + spread(burst.known, self._code1)
            inputs, target = burst.samples, chips.astype(np.complex128)
        else:
            inputs, target = training_pair(burst.samples, pilot_chips)
        if self._stored is not None and self._anchor is None:
            few = ALIGN_SYMBOLS * len(self._code1) - 1
            self._anchor = aligned(self._stored, inputs, target[:few], STRIDE)
            self._taps = self._anchor
        if self.name == "least-squares":
            error = self._batch(burst, inputs, target, pilot_chips)
        else:
            error = self._adapt(inputs, target)
        points = self._equalised(burst)
        curve = per_symbol_db(error, len(self._code1))
        return Reception(np.ascontiguousarray(points.real), points, evm_db(points), self._taps, curve)

    def _equalised(self, burst: Burst) -> NDArray[np.complex128]:
        count = len(burst.pilots) * len(self._code1)
        return despread(windows(burst.samples, count, len(self._taps), STRIDE) @ self._taps, self._code1)

    def _adapt(self, inputs: NDArray[np.complex128], target: NDArray[np.complex128]) -> NDArray[np.complex128]:
        found = self._run(inputs, target)
        self._taps = found.best if self._anchor is None else held(found.taps, self._anchor)
        return found.error

    def _run(self, inputs: NDArray[np.complex128], target: NDArray[np.complex128]) -> Adapted:
        if self._anchor is not None and self.name != "rls":
            return nlms(inputs, target, self._taps, STEP, STRIDE)
        match self.name:
            case "lms":
                return lms(inputs, target, self._taps, LMS_STEP, STRIDE)
            case "nlms":
                return nlms(inputs, target, self._taps, NLMS_STEP, STRIDE)
            case _:
                self._rls = self._rls or Rls(self._taps, FORGETTING)
                return self._rls.run(inputs, target, STRIDE)

    def _batch(
        self,
        burst: Burst,
        inputs: NDArray[np.complex128],
        target: NDArray[np.complex128],
        pilot_chips: NDArray[np.float64],
    ) -> NDArray[np.complex128]:
        """Least squares over the burst; then again with CH1 as decided."""
        taps = len(self._taps)
        if self._anchor is None:
            self._taps = least_squares(inputs, target, taps, STRIDE)
        known = burst.known is not None and bool(np.all(burst.known != 0.0))
        for _ in range(0 if known else DECISION_ROUNDS):
            decided = np.where(self._equalised(burst).real < 0.0, -1.0, 1.0)
            chips = pilot_chips + spread(decided, self._code1)
            inputs, target = burst.samples, chips.astype(np.complex128)
            self._taps = least_squares(inputs, target, taps, STRIDE)
        return np.asarray(target - windows(inputs, len(target), taps, STRIDE) @ self._taps, np.complex128)
