"""Pilot cancellation, matched filter and maximum-likelihood sequence estimation over two states.

CH1 is BPSK with the waveform g = channel * code. A response shorter than a symbol makes neighbours overlap once:
    y_m = sum conj(g[n]) r[n + m T],   rho_0 = sum |g|^2,   rho_1 = sum conj(g[n]) g[n - T]
and the likelihood is Re sum_m d_m (2 y_m - 2 rho_1 d_{m-1}) up to a constant (Ungerboeck 1974), maximised by Viterbi.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import kernel
from services.track_circuit.burst_sums import matched_without_pilot
from services.track_circuit.channel_estimate import (
    TAPS,
    NormalEquations,
    delay_and_add,
    observed_rows,
    response,
    rows_of,
)
from services.track_circuit.modulate import spread
from services.track_circuit.profile import Profile
from services.track_circuit.receiver import Burst, ReceiverRefusedError, Reception, StoredTaps
from services.track_circuit.walsh import code
from services.track_circuit.warm_start import ALIGN_SYMBOLS

SHORTEST_CODE = 8
"""Chips."""
MEMORY = 0.8
"""Share of the channel estimate's sums kept from one burst to the next."""
SHORT = 3.0
"""How strongly a second beginning prefers short responses."""
ROUNDS = 2
"""Decide, estimate the channel with the decisions, decide again."""


@kernel
def sequence_soft(matched: NDArray[np.float64], overlap: float) -> NDArray[np.float64]:
    """Max-log difference of the best sequences with d_m = +1 and d_m = -1, divided by 4.

    `matched` holds Re y_m / rho_0 and `overlap` Re rho_1 / rho_0; without overlap the result is `matched`.
    """
    count = len(matched)
    forward = np.zeros((count, 2))
    backward = np.zeros((count, 2))
    for m in range(count):
        for state in range(2):
            d = 1.0 - 2.0 * state
            best = 0.0
            if m > 0:
                same = forward[m - 1, state] - 2.0 * overlap
                other = forward[m - 1, 1 - state] + 2.0 * overlap
                best = max(same, other)
            forward[m, state] = best + 2.0 * d * matched[m]
    for m in range(count - 2, -1, -1):
        for state in range(2):
            d = 1.0 - 2.0 * state
            same = backward[m + 1, state] + 2.0 * d * matched[m + 1] - 2.0 * overlap
            other = backward[m + 1, 1 - state] - 2.0 * d * matched[m + 1] + 2.0 * overlap
            backward[m, state] = max(same, other)
    found = np.empty(count)
    for m in range(count):
        found[m] = 0.25 * (forward[m, 0] + backward[m, 0] - forward[m, 1] - backward[m, 1])
    return found


def matched_outputs(
    residual: NDArray[np.complex128], waveform: NDArray[np.complex128], symbol_samples: int, count: int
) -> NDArray[np.complex128]:
    """y_m / rho_0 for `count` symbols; `residual` and `waveform` begin at the same place before a symbol."""
    windows = np.lib.stride_tricks.sliding_window_view(residual, len(waveform))[::symbol_samples][:count]
    return np.asarray(windows @ np.conj(waveform) / (np.sum(np.abs(waveform) ** 2) + 1e-30), np.complex128)


def signs(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """+1 or -1; +1 for 0."""
    return np.where(values < 0.0, -1.0, 1.0)


@dataclass(frozen=True, slots=True)
class _Refined:
    """A burst decided over and over."""

    sums: NormalEquations
    taps: NDArray[np.complex128]
    soft: NDArray[np.float64]
    points: NDArray[np.complex128]
    errors: list[float]


class MlseReceiver:
    """The default receiver: within 0.3 dB of the matched-filter bound where the response is shorter than a symbol."""

    name = "mlse"

    def __init__(self, profile: Profile, stored: StoredTaps | None = None) -> None:
        """Begin with the stored response, or with none.

        Raises ReceiverRefusedError when the response may last longer than a symbol: two states would not do.
        """
        if profile.code_length < SHORTEST_CODE:
            msg = (
                f"the code of {profile.code_length} chips is too short for two states: at least {SHORTEST_CODE} chips "
                "are needed, as long as a response behind tuned units lasts"
            )
            raise ReceiverRefusedError(msg)
        self._length = min(TAPS, profile.code_length)
        """Chips of the response: within a symbol, so that no more than neighbours overlap."""
        self._profile = profile
        self._code1 = code(profile.code_length, profile.ch1_row)
        self._code2 = profile.ch2_amplitude * code(profile.code_length, profile.ch2_row)
        self._sums = NormalEquations(self._length)
        self._taps = None if stored is None else stored.taps.reshape(2, self._length)
        self._aligned = stored is None

    def receive(self, burst: Burst) -> Reception:
        """Decide a burst: estimate, cancel the pilot, match, search; then once more with the decisions."""
        pilot_chips = spread(burst.pilots, self._code2)
        if self._taps is None:
            taps = self._from_pilot(burst, pilot_chips)
        else:
            taps = self._taps if self._aligned else self._with_gain(burst, pilot_chips, self._taps)
        refined = self._refined(burst, pilot_chips, self._decide(burst, taps, pilot_chips)[0])
        if self._taps is None and burst.known is None:
            # A row that hardly excites CH1's band leaves that band open: of several beginnings the best fit counts.
            short = self._decide(burst, self._from_pilot(burst, pilot_chips, SHORT), pilot_chips)[0]
            others = [self._refined(burst, pilot_chips, soft) for soft in (short, -short)]
            refined = min([refined, *others], key=lambda one: one.sums.misfit(one.taps))
        self._sums, self._taps, self._aligned = refined.sums, refined.taps, True
        error_db = 10.0 * np.log10(np.asarray(refined.errors) + 1e-12)
        return Reception(refined.soft, refined.points, float(error_db[-1]), refined.taps, error_db)

    def copied(self) -> MlseReceiver:
        """Another one; what was learned is replaced and never changed, so that both may share it."""
        return copy.copy(self)

    def _refined(self, burst: Burst, pilot_chips: NDArray[np.float64], soft: NDArray[np.float64]) -> _Refined:
        """The response with first decisions, decisions with that, and so on."""
        sums, taps, points = self._sums, np.zeros((2, self._length), np.complex128), np.zeros(len(soft), np.complex128)
        errors = []
        for _ in range(ROUNDS):
            symbols = signs(soft) if burst.known is None else np.where(burst.known == 0.0, signs(soft), burst.known)
            sums = self._with_decisions(burst, pilot_chips, symbols)
            taps = sums.solve()
            soft, points = self._decide(burst, taps, pilot_chips)
            errors.append(float(np.mean(np.abs(points - signs(soft)) ** 2)))
        return _Refined(sums, taps, soft, points, errors)

    def _from_pilot(
        self, burst: Burst, pilot_chips: NDArray[np.float64], spread: float = 0.0
    ) -> NDArray[np.complex128]:
        """The response from CH2 alone: delay-and-add takes CH1 away."""
        sums = NormalEquations(self._length)
        rows = delay_and_add(rows_of(pilot_chips, self._length)).real
        sums.add(rows, delay_and_add(observed_rows(burst.samples, len(pilot_chips), self._length)))
        return sums.solve(spread)

    def _with_gain(
        self, burst: Burst, pilot_chips: NDArray[np.float64], stored: NDArray[np.complex128]
    ) -> NDArray[np.complex128]:
        """The stored response with the complex gain of the burst's first pilot bits."""
        few = ALIGN_SYMBOLS * self._profile.code_length
        rows = delay_and_add(rows_of(pilot_chips, self._length))[:few]
        heard = delay_and_add(observed_rows(burst.samples, len(pilot_chips), self._length))[: len(rows)]
        hoped = rows @ stored.T
        gain = np.vdot(hoped, heard) / (float(np.sum(np.abs(hoped) ** 2)) + 1e-30)
        return np.asarray(stored * gain, np.complex128)

    def _with_decisions(
        self, burst: Burst, pilot_chips: NDArray[np.float64], symbols: NDArray[np.float64]
    ) -> NormalEquations:
        sums = self._sums.copy()
        sums.fade(MEMORY)
        chips = pilot_chips + spread(symbols, self._code1)
        sums.add_burst(chips, burst.samples)
        return sums

    def _decide(
        self, burst: Burst, taps: NDArray[np.complex128], pilot_chips: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
        """Soft values, and the constellation with decided neighbours taken out."""
        waveform = response(taps, self._code1)
        symbol_samples = 2 * self._profile.code_length
        matched = np.empty(len(burst.pilots), np.complex128)
        matched_without_pilot(burst.samples, pilot_chips, taps, waveform, symbol_samples, matched)
        energy = float(np.sum(np.abs(waveform) ** 2)) + 1e-30
        overlap = np.vdot(waveform[symbol_samples:], waveform[:-symbol_samples]) / energy
        soft = sequence_soft(np.ascontiguousarray(matched.real), float(overlap.real))
        points = matched.copy()
        decided = signs(soft)
        points[1:] -= np.conj(overlap) * decided[:-1]
        points[:-1] -= overlap * decided[1:]
        return soft, points
