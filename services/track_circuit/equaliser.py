"""Linear receivers: a chip equaliser at two samples per chip, trained on CH2 behind delay-and-add, then despreading.

`lms` is the paper's (Arai et al., section 2): delay-and-add cancels CH1, CH2's chips delayed and added are the
training signal, and the coefficients at the smallest mean square error equalise CH1.
"""

from __future__ import annotations

import copy
from typing import Literal

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
HALF_CHIP_TAPS = 16
"""Of the equaliser: 8 chips, from 3 before the chip to 5 after it. More taps learn more slowly and gain nothing."""
STRIDE = 2
"""Inputs per chip."""
LMS_STEP, NLMS_STEP = 0.2, 0.5
FORGETTING = 0.9995
"""Of RLS, per chip: a memory of 125 symbols of 16 chips."""
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
        self.name: str = algorithm
        self._algorithm = algorithm
        self._code1 = code(profile.code_length, profile.ch1_row)
        self._code2 = profile.ch2_amplitude * code(profile.code_length, profile.ch2_row)
        self._taps = np.zeros(taps if stored is None else len(stored.taps), np.complex128)
        self._stored = None if stored is None else stored.taps
        self._anchor: NDArray[np.complex128] | None = None
        self._rls: Rls | None = None

    def receive(self, burst: Burst) -> Reception:
        """Train on the burst's pilots (and on CH1 where known), then equalise and despread it."""
        pilot_chips = spread(burst.pilots, self._code2)
        inputs, target = training_pair(burst.samples, pilot_chips)
        if self._stored is not None and self._anchor is None:
            few = ALIGN_SYMBOLS * len(self._code1) - 1
            self._anchor = self._taps = aligned(self._stored, inputs, target[:few], STRIDE)
        known = burst.known is not None and bool(np.all(burst.known != 0.0))
        if self._anchor is None and not known:
            error = self._from_pilots(inputs, target)
        if self._anchor is not None or known or self._algorithm in ("rls", "least-squares"):
            decided = burst.known if known and burst.known is not None else self._decisions(burst)
            chips = pilot_chips + spread(decided, self._code1)
            error = self._from_chips(burst.samples, chips.astype(np.complex128))
        points = self._equalised(burst)
        curve = per_symbol_db(error, len(self._code1))
        return Reception(np.ascontiguousarray(points.real), points, evm_db(points), self._taps, curve)

    def copied(self) -> LinearReceiver:
        """Another one that knows the same."""
        return copy.deepcopy(self)

    def _equalised(self, burst: Burst) -> NDArray[np.complex128]:
        count = len(burst.pilots) * len(self._code1)
        return despread(windows(burst.samples, count, len(self._taps), STRIDE) @ self._taps, self._code1)

    def _decisions(self, burst: Burst) -> NDArray[np.float64]:
        return np.where(self._equalised(burst).real < 0.0, -1.0, 1.0)

    def _from_pilots(self, inputs: NDArray[np.complex128], target: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Training on CH2 alone, as in the paper; RLS and least squares go on with decisions, if they can decide."""
        match self._algorithm:
            case "lms":
                found = lms(inputs, target, self._taps, LMS_STEP, STRIDE)
            case "nlms":
                found = nlms(inputs, target, self._taps, NLMS_STEP, STRIDE)
            case _ if np.any(self._taps):
                return target
            case "rls":
                found = Rls(self._taps).run(inputs, target, STRIDE)
            case "least-squares":
                best = least_squares(inputs, target, len(self._taps), STRIDE)
                found = Adapted(best, best, target)
        self._taps = found.best
        return found.error

    def _from_chips(self, inputs: NDArray[np.complex128], target: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Training on both channels, CH1 as known or decided: no bias, no notch at CH1's frequency."""
        if self._algorithm == "least-squares":
            self._taps = least_squares(inputs, target, len(self._taps), STRIDE)
            return np.asarray(
                target - windows(inputs, len(target), len(self._taps), STRIDE) @ self._taps, np.complex128
            )
        if self._algorithm == "rls" and self._anchor is None:
            self._rls = self._rls or Rls(np.zeros_like(self._taps), FORGETTING)
            found = self._rls.run(inputs, target, STRIDE)
        else:
            found = nlms(inputs, target, self._taps, NLMS_STEP if self._anchor is None else STEP, STRIDE)
        self._taps = found.best if self._anchor is None else held(found.taps, self._anchor)
        return found.error
