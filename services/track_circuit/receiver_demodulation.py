"""From samples to symbols: blank impulses, seek the signal, receive burst by burst, seek anew when it is lost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.blanking import without_impulses
from services.track_circuit.profile import Profile, ProfileError
from services.track_circuit.receiver import Demodulation, StoredTaps, Synchronisation, nothing_received
from services.track_circuit.receiver_bursts import BURST_SYMBOLS, FOLLOWED_COHERENCE, GUARD_SYMBOLS, BurstChain, Piece
from services.track_circuit.receiver_choice import receiver_named
from services.track_circuit.signal_front_end import FrontEnd
from services.track_circuit.synchronise import FEWEST_SYMBOLS, WINDOW_SYMBOLS, acquire

LOST_BURSTS = 2
"""Bursts in a row below it, after which the signal is sought anew."""
ABSENT = 0.3
"""Presence below which symbols at the begin and the end of a signal are taken for silence."""
SHORTEST_SILENCE = 3
"""Symbols that are cut from a burst in the midst of a signal; at its very begin and end a single one is."""

RUN_IN_SYMBOLS = 8
"""Symbols before the pilot's first one that may be noise at the begin of a recording."""
SURE, SINGLE = 0.5, 0.4
"""Their mean presence from which they are signal after all: for so many as make chance small, and more for one."""


class Demodulator:
    """Symbols out of contiguous samples, which may arrive in pieces.

    `take` gives what could be decided; the first symbols need WINDOW_SYMBOLS of signal, later ones a burst and its
    guards. `finish` decides the rest. Samples have full scale ±1.
    """

    def __init__(
        self, sample_rate_hz: float, profile: Profile, receiver: str = "mlse", stored: StoredTaps | None = None
    ) -> None:
        """Ready for the first sample. Raises as `receiver_named` and FrontEnd do, ProfileError for FSK."""
        if profile.scheme != "ss-cdma":
            msg = f"scheme {profile.scheme!r} is not received here but by its own module"
            raise ProfileError(msg)
        receiver_named(receiver, profile, stored)
        self._profile, self._name, self._stored = profile, receiver, stored
        self._rate_hz = sample_rate_hz
        self._front_end = FrontEnd(sample_rate_hz, profile.chip_rate_hz)
        self._stretch = round(sample_rate_hz / profile.symbol_rate_hz)
        self._period = len(profile.pilots())
        self._buffer = np.empty(0)
        self._dropped = 0
        """Samples that were given and are no longer kept."""
        self._chain: BurstChain | None = None
        self._sync: Synchronisation | None = None
        self._last: tuple[int, float] | None = None
        """Number and sample of the last symbol given out."""
        self._origin: int | None = None
        """Whole periods of the pilot in which there was only silence yet."""
        self._poor: list[Piece] = []
        self._losses = 0
        self._blanked = 0

    def take(self, samples: NDArray[np.float64]) -> Demodulation:
        """Symbols that these samples complete. Raises ValueError for samples that are not finite numbers in a row."""
        fresh = np.asarray(samples, np.float64)
        if fresh.ndim != 1 or not np.isfinite(fresh).all():
            msg = f"samples must be one row of finite numbers, not shape {fresh.shape}"
            raise ValueError(msg)
        fresh, blanked = without_impulses(fresh, self._stretch)
        self._blanked += blanked
        self._buffer = np.concatenate([self._buffer, fresh])
        return self._joined(self._run(last=False))

    def finish(self) -> Demodulation:
        """What is left at the end of the samples."""
        pieces = self._run(last=True)
        pieces += self._poor
        self._poor = []
        return self._joined(pieces)

    def _run(self, *, last: bool) -> list[Piece]:
        found: list[Piece] = []
        while True:
            if self._chain is None and not self._seek(last=last):
                break
            chain = self._chain
            if chain is None:
                break
            left = chain.symbols_left(len(self._buffer) - (0 if last else self._front_end.reach))
            wanted = BURST_SYMBOLS if left >= BURST_SYMBOLS + GUARD_SYMBOLS else left
            if wanted < (1 if last else BURST_SYMBOLS):
                break
            found += self._judged(chain.step(self._buffer, wanted))
        self._forget()
        return found

    def _seek(self, *, last: bool) -> bool:
        """Look for the signal; samples in which there is none are given up."""
        window = WINDOW_SYMBOLS * self._stretch
        while len(self._buffer) >= window or (last and len(self._buffer)):
            found = acquire(self._buffer, 0, self._profile, self._front_end)
            if found is not None:
                self._sync = self._sync or found
                receiver = receiver_named(self._name, self._profile, self._stored)
                self._chain = BurstChain(self._profile, self._front_end, receiver, self._renumbered(found))
                return True
            self._drop(min(len(self._buffer), window // 2))
        return False

    def _renumbered(self, found: Synchronisation) -> Synchronisation:
        """Pilot numbers that go on from the last symbol over a loss, by the time that passed."""
        if self._last is None:
            return found
        symbol, sample = self._last
        at = found.position + self._dropped
        expected = symbol + (at - sample) / (found.samples_per_chip * self._profile.code_length)
        periods = max(0, round((expected - found.pilot) / self._period))
        return Synchronisation(
            position=found.position,
            samples_per_chip=found.samples_per_chip,
            carrier_hz=found.carrier_hz,
            phase_turns=found.phase_turns,
            pilot=found.pilot + periods * self._period,
            quality=found.quality,
        )

    def _judged(self, piece: Piece) -> list[Piece]:
        """What to give out: a poor burst waits for its successor; two of them end the chain."""
        shifted = self._absolute(piece)
        if piece.coherence >= FOLLOWED_COHERENCE:
            given = [*self._poor, shifted]
            self._poor = []
            self._last = int(shifted.symbol[-1]), float(shifted.sample[-1])
            return given
        self._poor.append(shifted)
        if len(self._poor) < LOST_BURSTS:
            return []
        begin = self._poor[0].sample[0] - self._dropped
        self._drop(int(min(max(begin, 0.0) + self._stretch * BURST_SYMBOLS // 2, len(self._buffer))))
        self._poor, self._chain = [], None
        self._losses += 1
        return []

    def _absolute(self, piece: Piece) -> Piece:
        return Piece(
            piece.symbol,
            piece.sample + self._dropped,
            piece.soft,
            piece.presence,
            piece.coherence,
            piece.level_db,
            piece.reception,
            piece.constellation,
            piece.carrier_hz,
            piece.samples_per_chip,
            piece.tones_hz,
        )

    def _drop(self, count: int) -> None:
        self._buffer = self._buffer[count:]
        self._dropped += count
        if self._chain is not None:
            self._chain.place.rebase(count, self._rate_hz)

    def _forget(self) -> None:
        """Keep no more than a burst's guards, the filter's reach and poor bursts need."""
        if self._chain is None:
            return
        keep = self._stretch * (GUARD_SYMBOLS + 2 + BURST_SYMBOLS * len(self._poor)) + self._front_end.reach
        count = int(self._chain.place.position) - keep
        if count > 0:
            self._drop(count)

    def _joined(self, pieces: list[Piece]) -> Demodulation:
        first = self._origin is None
        trimmed = [
            (piece, _present(piece, 1 if first and k == 0 else SHORTEST_SILENCE)) for k, piece in enumerate(pieces)
        ]
        if first and trimmed:
            _drop_run_in(*trimmed[0], self._period)
        parts = [(piece, keep) for piece, keep in trimmed if keep.any()]
        if not parts:
            return self._nothing()
        counts = [int(keep.sum()) for _, keep in parts]
        soft = np.concatenate([piece.soft[keep] for piece, keep in parts])
        symbol = np.concatenate([piece.symbol[keep] for piece, keep in parts])
        if self._origin is None:
            self._origin = int(symbol[0]) // self._period * self._period
        nominal = self._rate_hz / self._profile.chip_rate_hz
        tones = {round(tone, 1) for piece, _ in parts for tone in piece.tones_hz}
        return Demodulation(
            symbol=symbol - self._origin,
            sample=np.concatenate([piece.sample[keep] for piece, keep in parts]),
            bit=(soft < 0.0).astype(np.int8),
            soft=soft,
            level_db=np.repeat([piece.level_db for piece, _ in parts], counts),
            evm_db=np.repeat([piece.reception.evm_db for piece, _ in parts], counts),
            carrier_offset_hz=np.repeat([piece.carrier_hz - self._profile.carrier_hz for piece, _ in parts], counts),
            clock_offset_ppm=np.repeat([(nominal / piece.samples_per_chip - 1.0) * 1e6 for piece, _ in parts], counts),
            receiver=self._name,
            taps=parts[-1][0].reception.taps,
            error_db=np.concatenate([piece.reception.error_db for piece, _ in parts]),
            constellation=np.concatenate([piece.constellation[keep] for piece, keep in parts]),
            sync=self._sync,
            losses=self._losses,
            blanked=self._blanked,
            lines_hz=tuple(sorted(tones)),
        )

    def _nothing(self) -> Demodulation:
        where = f"CH2 on row {self._profile.ch2_row} near {self._profile.carrier_hz:g} Hz"
        refused = "" if self._sync else f"no signal with {where} ({FEWEST_SYMBOLS} symbols are needed)"
        return nothing_received(self._name, refused, self._sync, self._losses, self._blanked)


def _present(piece: Piece, shortest: int) -> NDArray[np.bool_]:
    """Symbols of a piece without silence at its begin and its end; none of a piece without signal.

    The stretch with the greatest sum of presence above ABSENT; what is cut has at least `shortest` symbols.
    """
    keep = np.zeros(len(piece.soft), np.bool_)
    if not piece.coherence >= FOLLOWED_COHERENCE:
        return keep
    total = np.concatenate([[0.0], np.cumsum(piece.presence - ABSENT)])
    lowest = np.minimum.accumulate(total)
    end = int(np.argmax(total - lowest))
    begin = int(np.flatnonzero(total[: end + 1] == lowest[end])[-1])
    begin = begin if begin >= shortest else 0
    end = end if len(keep) - end >= shortest else len(keep)
    keep[begin:end] = True
    return keep


def _drop_run_in(piece: Piece, keep: NDArray[np.bool_], period: int) -> None:
    """Take out of `keep` what comes just before the pilot's first symbol, unless it is surely signal.

    Most recordings begin with that symbol, few within the last ones before it: noise that looked like a symbol would
    number all that follows a period too high.
    """
    kept = np.flatnonzero(keep)[: RUN_IN_SYMBOLS + 1]
    wraps = np.flatnonzero(piece.symbol[kept] % period == 0)
    count = int(wraps[0]) if len(wraps) else 0
    if count and float(np.mean(piece.presence[kept[:count]])) < SURE + SINGLE / np.sqrt(count):
        keep[: kept[count]] = False


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
    parts = [part for part in (demodulator.take(samples), demodulator.finish()) if len(part.bit)]
    if len(parts) < 2:  # noqa: PLR2004 - nothing to join
        return parts[0] if parts else demodulator.finish()
    return joined(parts)


def joined(parts: list[Demodulation]) -> Demodulation:
    """Results of one Demodulator in their order as one, with symbol numbers from the first period on."""
    last = parts[-1]
    return Demodulation(
        symbol=np.concatenate([part.symbol for part in parts]),
        sample=np.concatenate([part.sample for part in parts]),
        bit=np.concatenate([part.bit for part in parts]),
        soft=np.concatenate([part.soft for part in parts]),
        level_db=np.concatenate([part.level_db for part in parts]),
        evm_db=np.concatenate([part.evm_db for part in parts]),
        carrier_offset_hz=np.concatenate([part.carrier_offset_hz for part in parts]),
        clock_offset_ppm=np.concatenate([part.clock_offset_ppm for part in parts]),
        receiver=last.receiver,
        taps=last.taps,
        error_db=np.concatenate([part.error_db for part in parts]),
        constellation=np.concatenate([part.constellation for part in parts]),
        sync=last.sync,
        losses=last.losses,
        blanked=last.blanked,
        lines_hz=tuple(sorted({line for part in parts for line in part.lines_hz})),
    )
