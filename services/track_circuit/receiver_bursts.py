"""Bursts cut out of the samples and received, carrier and clock followed from one to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.channel_estimate import LEAD, TAPS, response
from services.track_circuit.modulate import spread
from services.track_circuit.profile import Profile
from services.track_circuit.receiver import Burst, Receiver, Reception, Synchronisation
from services.track_circuit.signal_front_end import FrontEnd
from services.track_circuit.synchronisation_tracking import (
    CLOCK_GAIN,
    DELAY_GAIN,
    FREQUENCY_GAIN,
    PHASE_GAIN,
    Drift,
    ResponseTracker,
    burst_response,
)
from services.track_circuit.tone_cleaning import CleanReception
from services.track_circuit.walsh import code

BURST_SYMBOLS = 64
GUARD_SYMBOLS = 2
"""Symbols to either side that are received as well and not given out: their neighbours are missing."""
CUT_SYMBOL = 0.25
"""Share of a symbol that may be missing at either end of the samples."""
FOLLOWED_COHERENCE = 0.35
"""Below, a burst is none: noise has about 0.15, for the response is fitted to it, a signal at 4 dB 0.7."""


@dataclass
class Place:
    """Where the next symbol begins, on which clock and carrier; phase as of sample 0."""

    position: float
    samples_per_chip: float
    carrier_hz: float
    phase_turns: float
    pilot: int

    def rebase(self, samples: int, sample_rate_hz: float) -> None:
        """Count from a later sample."""
        self.position -= samples
        self.phase_turns = (self.phase_turns + self.carrier_hz / sample_rate_hz * samples) % 1.0


@dataclass(frozen=True, slots=True)
class Piece:
    """Symbols of one burst."""

    symbol: NDArray[np.int64]
    sample: NDArray[np.float64]
    soft: NDArray[np.float64]
    presence: NDArray[np.float64]
    """CH2's amplitude per symbol relative to the burst's mean: near 1 where there is signal, near 0 where not."""
    coherence: float
    """Share of CH2's correlation that has the pilot's signs: 1 without noise, 1/symbols without signal."""
    level_db: float
    reception: Reception
    constellation: NDArray[np.complex128]
    carrier_hz: float
    samples_per_chip: float
    tones_hz: tuple[float, ...]


class BurstChain:
    """Receives burst after burst from a place on."""

    def __init__(self, profile: Profile, front_end: FrontEnd, receiver: Receiver, found: Synchronisation) -> None:
        """Begin where the synchronisation found the signal."""
        self._profile, self._front_end = profile, front_end
        self._receiver = CleanReception(profile, receiver)
        self._pilots = profile.pilots()
        self._code1 = code(profile.code_length, profile.ch1_row)
        self._code2 = profile.ch2_amplitude * code(profile.code_length, profile.ch2_row)
        self._tracker = ResponseTracker()
        self.place = Place(found.position, found.samples_per_chip, found.carrier_hz, found.phase_turns, found.pilot)
        per_symbol = found.samples_per_chip * profile.code_length
        if found.position >= (1.0 - CUT_SYMBOL) * per_symbol and found.pilot > 0:
            self.place.position -= per_symbol
            self.place.pilot -= 1

    def symbols_left(self, samples: int) -> int:
        """Symbols from the place to the end of `samples` samples, a slightly cut one included."""
        per_symbol = self.place.samples_per_chip * self._profile.code_length
        return int((samples - self.place.position) / per_symbol + CUT_SYMBOL)

    def _burst(self, samples: NDArray[np.float64], symbols: int) -> tuple[Burst, int]:
        """A burst with guards where there are samples for them, and the number of guards before."""
        place, length = self.place, self._profile.code_length
        per_symbol = place.samples_per_chip * length
        before = max(0, min(GUARD_SYMBOLS, int(place.position / per_symbol)))
        total = before + min(symbols + GUARD_SYMBOLS, self.symbols_left(len(samples)))
        start = place.position - before * per_symbol - LEAD * place.samples_per_chip
        count = 2 * (LEAD + total * length + TAPS)
        step = place.samples_per_chip / 2.0
        baseband = self._front_end.baseband(samples, start, step, count, place.carrier_hz, place.phase_turns)
        index = (place.pilot - before + np.arange(total)) % len(self._pilots)
        return Burst(baseband, self._pilots[index]), before

    def step(self, samples: NDArray[np.float64], symbols: int = BURST_SYMBOLS) -> Piece:
        """Receive the next `symbols` symbols, fewer at the end of the samples, and move on."""
        place = self.place
        burst, before = self._burst(samples, symbols)
        given = min(symbols, len(burst.pilots) - before)
        reception, burst, tones = self._receiver.receive(burst, place.carrier_hz)
        inner = slice(before, before + given)
        decided = np.where(reception.soft < 0.0, -1.0, 1.0)
        chips = spread(burst.pilots, self._code2) + spread(decided, self._code1)
        taps = burst_response(burst.samples, chips)
        presence, coherence = self._presence(burst, taps)
        per_symbol = place.samples_per_chip * self._profile.code_length
        piece = Piece(
            symbol=place.pilot + np.arange(given),
            sample=place.position + per_symbol * np.arange(given, dtype=np.float64),
            soft=reception.soft[inner],
            presence=presence[inner],
            coherence=coherence,
            level_db=float(10.0 * np.log10(0.25 * np.sum(np.abs(taps) ** 2) + 1e-20)),
            reception=reception,
            constellation=reception.constellation[inner],
            carrier_hz=place.carrier_hz,
            samples_per_chip=place.samples_per_chip,
            tones_hz=tuple(float(place.carrier_hz + tone * 2.0 * self._profile.chip_rate_hz) for tone in tones),
        )
        self._move(taps if coherence >= FOLLOWED_COHERENCE else None, given)
        return piece

    def _presence(self, burst: Burst, taps: NDArray[np.complex128]) -> tuple[NDArray[np.float64], float]:
        """CH2's correlation per symbol relative to its mean, and its coherence."""
        waveform = response(taps, self._code2)
        step = 2 * self._profile.code_length
        missing = max(0, step * (len(burst.pilots) - 1) + len(waveform) - len(burst.samples))
        padded = np.concatenate([burst.samples, np.zeros(missing)])
        rows = np.lib.stride_tricks.sliding_window_view(padded, len(waveform))[::step][: len(burst.pilots)]
        heard = (rows @ np.conj(waveform)) * burst.pilots
        mean = heard.mean()
        power = float(np.mean(np.abs(heard) ** 2)) + 1e-30
        along = np.real(heard * np.conj(mean)) / (abs(mean) ** 2 + 1e-30)
        return np.asarray(along, np.float64), float(abs(mean) ** 2) / power

    def _move(self, taps: NDArray[np.complex128] | None, given: int) -> None:
        """Correct clock and carrier, unless there is no signal, and go to the next burst."""
        place = self.place
        drift = Drift(0.0, 0.0) if taps is None else self._tracker.step(taps)
        per_symbol = place.samples_per_chip * self._profile.code_length
        change_hz = FREQUENCY_GAIN * drift.phase_turns * self._profile.symbol_rate_hz / given
        place.position += given * per_symbol + DELAY_GAIN * drift.delay_chips * place.samples_per_chip
        place.samples_per_chip *= 1.0 + CLOCK_GAIN * drift.delay_chips / (given * self._profile.code_length)
        # The phase is kept at the new position, although it is counted from sample 0.
        place.phase_turns += PHASE_GAIN * drift.phase_turns
        place.phase_turns = (place.phase_turns - change_hz * place.position / self._front_end.sample_rate_hz) % 1.0
        place.carrier_hz += change_hz
        place.pilot += given
