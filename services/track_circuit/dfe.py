"""Decision feedback on chips: past chips, known or decided, take their tails out of the present one.

    y[k] = sum w[j] x[2 k + j] + sum v[i] s[k - 1 - i]
Within a symbol only CH1's bit d is unknown, and the error is linear in it: e[k] = d b[k] - a[k]. So
d = Re sum conj(b) a / sum |b|^2 despreads and decides at once, without deciding single chips.
"""

from __future__ import annotations

import copy

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import kernel
from services.track_circuit.equaliser import STRIDE, Algorithm, LinearReceiver, evm_db, per_symbol_db
from services.track_circuit.least_squares import windows
from services.track_circuit.modulate import spread
from services.track_circuit.profile import Profile
from services.track_circuit.receiver import Burst, Reception, StoredTaps
from services.track_circuit.walsh import code

FORWARD_TAPS = 16
"""Half chips: from 3 chips before the chip to 5 after it."""
FEEDBACK_TAPS = 4
"""Chips."""
ROUNDS = 2
RIDGE = 1e-3
START: Algorithm = "least-squares"


@kernel
def _fed_back(
    outputs: NDArray[np.complex128],
    shape: NDArray[np.complex128],
    after: NDArray[np.complex128],
    energy: float,
    points: NDArray[np.complex128],
) -> None:
    """points[m] = sum of shape x outputs over symbol m, by `energy`; outputs get decision x `after` behind it."""
    length = len(shape)
    for m in range(len(points)):
        total = 0.0 + 0.0j
        for k in range(length):
            total += shape[k] * outputs[m * length + k]
        points[m] = total / energy
        sign = -1.0 if total.real < 0.0 else 1.0
        for k in range(min(len(after), len(outputs) - (m + 1) * length)):
            outputs[(m + 1) * length + k] += sign * after[k]


class DfeReceiver:
    """Feed-forward and feedback filter by least squares over each burst, with CH1 as known or decided."""

    name = "dfe"

    def __init__(self, profile: Profile, stored: StoredTaps | None = None) -> None:
        """Begin with the stored filters, or find the first decisions by linear least squares.

        Raises ReceiverRefusedError as LinearReceiver does, unless there are stored filters.
        """
        self._code1 = code(profile.code_length, profile.ch1_row)
        self._code2 = profile.ch2_amplitude * code(profile.code_length, profile.ch2_row)
        self._taps = None if stored is None else stored.taps
        self._first = LinearReceiver(profile, START) if stored is None else None

    def receive(self, burst: Burst) -> Reception:
        """Decide a burst, learn from it, decide it again."""
        decided = burst.known
        if decided is None or np.any(decided == 0.0):
            decided = self._first_decisions(burst)
        points, error = self._learn_and_decide(burst, decided)
        for _ in range(ROUNDS - 1):
            points, error = self._learn_and_decide(burst, np.where(points.real < 0.0, -1.0, 1.0))
        curve = per_symbol_db(error, len(self._code1))
        taps = self._taps if self._taps is not None else np.zeros(0, np.complex128)
        return Reception(np.ascontiguousarray(points.real), points, evm_db(points), taps, curve)

    def copied(self) -> DfeReceiver:
        """Another one that knows the same."""
        return copy.deepcopy(self)

    def _first_decisions(self, burst: Burst) -> NDArray[np.float64]:
        if self._taps is not None:
            points = self._decide(burst, self._aligned(burst, self._taps))
        elif self._first is not None:
            points = self._first.receive(burst).constellation
        else:
            points = np.ones(len(burst.pilots), np.complex128)
        return np.where(points.real < 0.0, -1.0, 1.0)

    def _aligned(self, burst: Burst, taps: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Feed-forward taps with one complex gain, for which the pilots despread to what they are."""
        outputs = (
            windows(burst.samples, len(burst.pilots) * len(self._code1), FORWARD_TAPS, STRIDE) @ taps[:FORWARD_TAPS]
        )
        pilot = spread(burst.pilots, self._code2)
        tail = np.convolve(np.concatenate([[0.0], pilot]), taps[FORWARD_TAPS:])[: len(pilot)]
        wanted = pilot - tail
        pairs = slice(1, None)
        heard = (outputs[1:] + outputs[:-1])[pairs]
        hoped = (wanted[1:] + wanted[:-1])[pairs]
        gain = np.vdot(heard, hoped) / (float(np.sum(np.abs(heard) ** 2)) + 1e-30)
        return np.concatenate([taps[:FORWARD_TAPS] * gain, taps[FORWARD_TAPS:]])

    def _learn_and_decide(
        self, burst: Burst, decided: NDArray[np.float64]
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        chips = spread(burst.pilots, self._code2) + spread(decided, self._code1)
        past = np.lib.stride_tricks.sliding_window_view(chips[:-1], FEEDBACK_TAPS)[:, ::-1]
        forward = windows(burst.samples, len(chips), FORWARD_TAPS, STRIDE)[FEEDBACK_TAPS:]
        rows = np.hstack([forward, past.astype(np.complex128)])
        target = chips[FEEDBACK_TAPS:].astype(np.complex128)
        normal = rows.conj().T @ rows
        level = np.diag(normal).real
        weight = RIDGE * np.where(np.arange(len(level)) < FORWARD_TAPS, level[:FORWARD_TAPS].mean(), level.mean())
        taps = np.asarray(np.linalg.solve(normal + np.diag(weight + 1e-30), rows.conj().T @ target), np.complex128)
        self._taps = taps
        return self._decide(burst, taps), np.asarray(target - rows @ taps, np.complex128)

    def _decide(self, burst: Burst, taps: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Symbol by symbol; each decision enters the feedback of the next."""
        length = len(self._code1)
        forward, feedback = taps[:FORWARD_TAPS], taps[FORWARD_TAPS:]
        outputs = windows(burst.samples, len(burst.pilots) * length, FORWARD_TAPS, STRIDE) @ forward
        pilot = spread(burst.pilots, self._code2)
        tail = np.concatenate([[0.0], feedback])
        shape = self._code1 - np.convolve(self._code1, tail)[:length]
        energy = float(np.sum(np.abs(shape) ** 2))
        carried = np.convolve(pilot, tail)
        after = np.convolve(self._code1, tail)[length:]
        points = np.empty(len(burst.pilots), np.complex128)
        _fed_back(outputs - pilot + carried[: len(pilot)], np.conj(shape), after, energy, points)
        return points
