"""From samples to symbols: synchronise, cut into bursts, receive, follow carrier and clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.channel_estimate import LEAD, TAPS
from services.track_circuit.modulate import spread
from services.track_circuit.profile import Profile
from services.track_circuit.receiver import Burst, Demodulation, Receiver, StoredTaps, Synchronisation
from services.track_circuit.receiver_choice import receiver_named
from services.track_circuit.signal_front_end import FrontEnd
from services.track_circuit.synchronisation_tracking import (
    CLOCK_GAIN,
    DELAY_GAIN,
    FREQUENCY_GAIN,
    PHASE_GAIN,
    ResponseTracker,
    burst_response,
)
from services.track_circuit.synchronise import FEWEST_SYMBOLS, WINDOW_SYMBOLS, acquire
from services.track_circuit.walsh import code

BURST_SYMBOLS = 64
GUARD_SYMBOLS = 2
"""Symbols to either side that are received as well and not given out: their neighbours are missing."""
CUT_SYMBOL = 0.25
"""Share of a symbol that may be missing at the end of the samples."""


@dataclass
class _Place:
    """Where the next symbol begins, on which clock and carrier."""

    position: float
    samples_per_chip: float
    carrier_hz: float
    phase_turns: float
    pilot: int


@dataclass(frozen=True)
class _Piece:
    """Symbols of one burst."""

    symbol: NDArray[np.int64]
    sample: NDArray[np.float64]
    soft: NDArray[np.float64]
    level_db: NDArray[np.float64]
    evm_db: float
    carrier_hz: float
    samples_per_chip: float
    constellation: NDArray[np.complex128]
    taps: NDArray[np.complex128]
    error_db: NDArray[np.float64]


def _level_db(taps: NDArray[np.complex128], count: int) -> NDArray[np.float64]:
    """Power of one channel's chips behind the response: half of |baseband|^2 is the power of the real signal."""
    power = 0.25 * float(np.sum(np.abs(taps) ** 2))
    return np.full(count, 10.0 * np.log10(power + 1e-20))


class Demodulator:
    """Symbol by symbol through contiguous samples; `take` may be called as often as samples arrive."""

    def __init__(
        self, sample_rate_hz: float, profile: Profile, receiver: str = "mlse", stored: StoredTaps | None = None
    ) -> None:
        """Ready for the first sample. Raises as `receiver_named` and FrontEnd do."""
        self._profile = profile
        self._receiver: Receiver = receiver_named(receiver, profile, stored)
        self._begin_with = (receiver, stored)
        self._front_end = FrontEnd(sample_rate_hz, profile.chip_rate_hz)
        self._pilots = profile.pilots()
        self._code1 = code(profile.code_length, profile.ch1_row)
        self._code2 = profile.ch2_amplitude * code(profile.code_length, profile.ch2_row)
        self._place: _Place | None = None
        self._tracker = ResponseTracker()
        self.first_sync: Synchronisation | None = None

    def acquire(self, samples: NDArray[np.float64], begin: int) -> bool:
        """Seek the signal from sample `begin` on; True when found."""
        found = acquire(samples, begin, self._profile, self._front_end)
        if found is None:
            return False
        self.first_sync = self.first_sync or found
        self._place = _Place(found.position, found.samples_per_chip, found.carrier_hz, found.phase_turns, found.pilot)
        self._tracker = ResponseTracker()
        name, stored = self._begin_with
        self._receiver = receiver_named(name, self._profile, stored)
        return True

    def burst(self, samples: NDArray[np.float64], symbols: int) -> tuple[Burst, int] | None:
        """The next burst with guards where there are samples for them, and the number of guards before."""
        place = self._place
        if place is None:
            return None
        length = self._profile.code_length
        per_symbol = place.samples_per_chip * length
        before = min(GUARD_SYMBOLS, int(place.position / per_symbol))
        left = int((len(samples) - place.position) / per_symbol + CUT_SYMBOL)
        count = min(symbols + GUARD_SYMBOLS, left)
        if count < 1:
            return None
        total = before + count
        step = place.samples_per_chip / 2.0
        start = place.position - before * per_symbol - LEAD * place.samples_per_chip
        baseband = self._front_end.baseband(
            samples, start, step, 2 * (LEAD + total * length + TAPS), place.carrier_hz, place.phase_turns
        )
        index = (place.pilot - before + np.arange(total)) % len(self._pilots)
        return Burst(baseband, self._pilots[index]), before

    def step(self, samples: NDArray[np.float64], symbols: int = BURST_SYMBOLS) -> _Piece | None:
        """Receive the next burst and move on; None at the end of the samples."""
        cut = self.burst(samples, symbols)
        place = self._place
        if cut is None or place is None:
            return None
        burst, before = cut
        given = min(symbols, len(burst.pilots) - before)
        reception = self._receiver.receive(burst)
        inner = slice(before, before + given)
        decided = np.where(reception.soft < 0.0, -1.0, 1.0)
        chips = spread(burst.pilots, self._code2) + spread(decided, self._code1)
        taps = burst_response(burst.samples, chips)
        per_symbol = place.samples_per_chip * self._profile.code_length
        piece = _Piece(
            symbol=place.pilot + np.arange(given),
            sample=place.position + per_symbol * np.arange(given, dtype=np.float64),
            soft=reception.soft[inner],
            level_db=_level_db(taps, given),
            evm_db=reception.evm_db,
            carrier_hz=place.carrier_hz,
            samples_per_chip=place.samples_per_chip,
            constellation=reception.constellation[inner],
            taps=reception.taps,
            error_db=reception.error_db,
        )
        self._move(place, taps, given)
        return piece

    def _move(self, place: _Place, taps: NDArray[np.complex128], given: int) -> None:
        """Correct clock and carrier, and go to the next burst."""
        drift = self._tracker.step(taps)
        seconds = given / self._profile.symbol_rate_hz
        rate = self._front_end.sample_rate_hz
        per_symbol = place.samples_per_chip * self._profile.code_length
        place.position += given * per_symbol + DELAY_GAIN * drift.delay_chips * place.samples_per_chip
        place.samples_per_chip *= 1.0 + CLOCK_GAIN * drift.delay_chips / (given * self._profile.code_length)
        change_hz = FREQUENCY_GAIN * drift.phase_turns / seconds
        # The phase is kept at the new position, although it is counted from sample 0.
        place.phase_turns += PHASE_GAIN * drift.phase_turns - change_hz * place.position / rate
        place.phase_turns %= 1.0
        place.carrier_hz += change_hz
        place.pilot += given


def _joined(
    pieces: list[_Piece], demodulator: Demodulator, profile: Profile, rate_hz: float, name: str
) -> Demodulation:
    nominal = rate_hz / profile.chip_rate_hz
    counts = [len(piece.symbol) for piece in pieces]
    soft = np.concatenate([piece.soft for piece in pieces])
    return Demodulation(
        symbol=np.concatenate([piece.symbol for piece in pieces]),
        sample=np.concatenate([piece.sample for piece in pieces]),
        bit=(soft < 0.0).astype(np.int8),
        soft=soft,
        level_db=np.concatenate([piece.level_db for piece in pieces]),
        evm_db=np.repeat([piece.evm_db for piece in pieces], counts),
        carrier_offset_hz=np.repeat([piece.carrier_hz - profile.carrier_hz for piece in pieces], counts),
        clock_offset_ppm=np.repeat([(nominal / piece.samples_per_chip - 1.0) * 1e6 for piece in pieces], counts),
        receiver=name,
        taps=pieces[-1].taps,
        error_db=np.concatenate([piece.error_db for piece in pieces]),
        constellation=np.concatenate([piece.constellation for piece in pieces]),
        sync=demodulator.first_sync,
    )


def demodulate(
    samples: NDArray[np.float64],
    sample_rate_hz: float,
    profile: Profile,
    receiver: str = "mlse",
    stored: StoredTaps | None = None,
) -> Demodulation:
    """All symbols of a recording without gaps; `samples` have full scale ±1.

    Raises ReceiverRefusedError (with the reason) or ValueError when the receiver cannot work at all; a recording
    without signal gives an empty result whose `refused` says so.
    """
    demodulator = Demodulator(sample_rate_hz, profile, receiver, stored)
    source = np.ascontiguousarray(samples, np.float64)
    window = int(WINDOW_SYMBOLS * profile.code_length * sample_rate_hz / profile.chip_rate_hz)
    begin, pieces = 0, []
    while begin < len(source) and not demodulator.acquire(source, begin):
        begin += window // 2
    while (piece := demodulator.step(source)) is not None:
        pieces.append(piece)
    if not pieces:
        return _nothing(receiver, profile)
    return _joined(pieces, demodulator, profile, sample_rate_hz, receiver)


def _nothing(receiver: str, profile: Profile) -> Demodulation:
    none = np.empty(0)
    where = f"CH2 on row {profile.ch2_row} near {profile.carrier_hz:g} Hz"
    reason = f"no signal with {where} ({FEWEST_SYMBOLS} symbols are needed)"
    return Demodulation(
        symbol=none.astype(np.int64),
        sample=none,
        bit=none.astype(np.int8),
        soft=none,
        level_db=none,
        evm_db=none,
        carrier_offset_hz=none,
        clock_offset_ppm=none,
        receiver=receiver,
        taps=none.astype(np.complex128),
        error_db=none,
        constellation=none.astype(np.complex128),
        sync=None,
        refused=reason,
    )
