"""CDMA-QAM out of samples that keep coming: training is sought, then symbols are followed until the next one."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.cdma_qam import codes_of, despread_symbols, training_quality, training_symbols
from services.track_circuit.profile import Profile, ProfileError
from services.track_circuit.qam import levels, nearest
from services.track_circuit.qam_equaliser import (
    FEEDBACK_TAPS,
    FORWARD_TAPS,
    LEAD,
    QamFilter,
    QamTaps,
    carrier_turn,
    train,
)
from services.track_circuit.receiver import Demodulation, StoredTaps, nothing_received
from services.track_circuit.receiver_demodulation import joined
from services.track_circuit.signal_front_end import FrontEnd
from services.track_circuit.synchronisation_tracking import ResponseTracker

FOUND: Final = 0.5
"""Quality of the training above which a frame begins there."""
NEAR: Final = 16
"""Half symbols behind the first such place within which the best one is taken."""
CHUNK_BLOCKS: Final = 16
"""Blocks received at a time."""
GARBAGE: Final = 0.7
"""Error power over that of points spread evenly, 1/6 of the squared spacing, above which nothing was decided."""
LOST_CHUNKS: Final = 2
"""Such chunks in a row after which training is sought anew."""
CLOCK_GAIN: Final = 0.1
"""Share of a chunk's drift that is taken for the clock's."""
TAIL: Final = 2
"""Symbols by which filters and rail delay a signal: the last block ends so much behind the samples."""


def taps_of_qam(stored: StoredTaps, feedback: int) -> QamTaps:
    """Stored coefficients as filters. Raises ValueError when there are not as many as the receiver has."""
    if len(stored.taps) != FORWARD_TAPS + feedback:
        msg = f"{len(stored.taps)} stored coefficients for {FORWARD_TAPS + feedback} of receiver {stored.receiver!r}"
        raise ValueError(msg)
    return QamTaps(stored.taps[:FORWARD_TAPS], stored.taps[FORWARD_TAPS:])


@dataclass
class _Place:
    """Where the next symbol stands, on which clock and carrier; phase as of sample 0."""

    position: float
    samples_per_symbol: float
    carrier_hz: float
    phase_turns: float = 0.0

    def retune(self, change_hz: float, sample_rate_hz: float) -> None:
        """Another carrier, whose phase is the same at the place."""
        self.carrier_hz += change_hz
        self.phase_turns = (self.phase_turns - change_hz * self.position / sample_rate_hz) % 1.0


class QamDemodulator:
    """Bits out of contiguous samples in pieces; the first need the whole training, later ones CHUNK_BLOCKS.

    Receiver `dfe` feeds decisions back, `least-squares` does not. The equaliser starts from stored coefficients, or
    from those of the frame before, whose departure is kept small; then it follows its decisions, and so do carrier and
    clock. Bits are numbered through from frame to frame, and by time over a loss.
    """

    def __init__(
        self, sample_rate_hz: float, profile: Profile, receiver: str = "dfe", stored: StoredTaps | None = None
    ) -> None:
        """Ready for the first sample.

        Raises ProfileError for codes that do not fit, ValueError for a rate or stored coefficients that do not.
        """
        if profile.scheme != "cdma-qam" or receiver not in ("dfe", "least-squares"):
            msg = f"receiver {receiver!r} of scheme {profile.scheme!r}: CDMA-QAM has dfe and least-squares"
            raise ProfileError(msg)
        if stored is not None and stored.receiver != receiver:
            msg = f"stored coefficients of receiver {stored.receiver!r} do not fit {receiver!r}"
            raise ValueError(msg)
        codes_of(profile)
        self._profile, self._name, self._rate_hz = profile, receiver, sample_rate_hz
        self._feedback = FEEDBACK_TAPS if receiver == "dfe" else 0
        self._stored = None if stored is None else taps_of_qam(stored, self._feedback)
        self._front_end = FrontEnd(sample_rate_hz, profile.chip_rate_hz)
        self._known = training_symbols(profile)
        self._per_symbol = sample_rate_hz / profile.chip_rate_hz
        self._buffer = np.empty(0)
        self._dropped = 0
        self._place: _Place | None = None
        self._filter: QamFilter | None = None
        self._tracker = ResponseTracker()
        self._blocks_left = 0
        self._poor = self._losses = self._number = 0
        self._last: float | None = None
        """Sample behind the last bit given out."""

    def take(self, samples: NDArray[np.float64]) -> Demodulation:
        """Bits that these samples complete. Raises ValueError for samples that are not finite numbers in a row."""
        fresh = np.asarray(samples, np.float64)
        if fresh.ndim != 1 or not np.isfinite(fresh).all():
            msg = f"samples must be one row of finite numbers, not shape {fresh.shape}"
            raise ValueError(msg)
        self._buffer = np.concatenate([self._buffer, fresh])
        return self._run(last=False)

    def finish(self) -> Demodulation:
        """What is left at the end of the samples."""
        return self._run(last=True)

    def _run(self, *, last: bool) -> Demodulation:
        parts: list[Demodulation] = []
        while True:
            place, equaliser = self._place, self._filter
            if place is None or equaliser is None:
                if not self._seek(last=last):
                    break
                continue
            if self._profile.qam_blocks and not self._blocks_left:
                if not self._retrained(place, equaliser, last=last):
                    break
                continue
            blocks = self._ready(place, last=last)
            if not blocks:
                break
            parts += self._chunk(place, equaliser, blocks)
        self._forget()
        heard = [part for part in parts if len(part.bit)]
        reason = f"no CDMA-QAM training near {self._profile.carrier_hz:g} Hz"
        return joined(heard) if heard else nothing_received(self._name, "" if self._last is not None else reason)

    def _window(self, place: _Place, symbols: float, count: int) -> NDArray[np.complex128]:
        """Baseband for `count` symbols from `symbols` behind the place on, two per symbol and the filter's reach."""
        start = place.position + (symbols - LEAD) * place.samples_per_symbol
        step = place.samples_per_symbol / 2.0
        size = 2 * count + FORWARD_TAPS
        return self._front_end.baseband(self._buffer, start, step, size, place.carrier_hz, place.phase_turns)

    def _within(self, place: _Place, symbols: int, *, last: bool) -> bool:
        """Whether the samples reach as far as a window of so many symbols."""
        reach = (symbols + FORWARD_TAPS) * place.samples_per_symbol + self._front_end.reach
        return last or place.position + reach <= len(self._buffer)

    def _seek(self, *, last: bool) -> bool:
        """Look for training; samples in which none begins are given up."""
        step = self._per_symbol / 2.0
        count = int((len(self._buffer) - (0 if last else self._front_end.reach)) / step) + 4 * LEAD
        if count < 2 * len(self._known) + NEAR:
            return False
        start = -2 * LEAD * step
        baseband = self._front_end.baseband(self._buffer, start, step, count, self._profile.carrier_hz, 0.0)
        quality = training_quality(baseband, self._known)
        good = np.flatnonzero(quality >= FOUND)
        if not len(good):
            self._drop(max(0, int(start + (len(quality) - NEAR) * step)))
            return False
        best = int(good[0]) + int(np.argmax(quality[good[0] : good[0] + NEAR]))
        place = _Place(start + best * step, self._per_symbol, self._profile.carrier_hz)
        if not self._within(place, len(self._known), last=last):
            return False
        self._place = place
        # The carrier's offset blurs the training: measured once, taken off, trained anew.
        window = self._window(place, 0.0, len(self._known))
        taps = train(window, self._known, self._stored, feedback=self._feedback)
        place.retune(self._hz(carrier_turn(window, self._known, taps)[0]), self._rate_hz)
        self._train(place, self._stored)
        return True

    def _hz(self, radians_per_symbol: float) -> float:
        return radians_per_symbol / (2.0 * np.pi) * self._profile.chip_rate_hz

    def _train(self, place: _Place, stored: QamTaps | None) -> None:
        """Filters from the training at the place, which moves behind it."""
        known = self._known
        window = self._window(place, 0.0, len(known))
        taps = train(window, known, stored, feedback=self._feedback)
        self._filter = QamFilter(taps, self._profile.qam_order, known[::-1], carrier_turn(window, known, taps))
        self._tracker = ResponseTracker()
        self._tracker.step(taps.forward.reshape(-1, 2).T)
        self._blocks_left, self._poor = self._profile.qam_blocks, 0
        place.position += len(known) * place.samples_per_symbol

    def _retrained(self, place: _Place, equaliser: QamFilter, *, last: bool) -> bool:
        """Go on with the training that is due; False when more samples are needed. Without it the signal is lost."""
        if not self._within(place, len(self._known), last=last):
            return False
        window = self._window(place, LEAD - 1.0, len(self._known) + 1)[: 2 * len(self._known) + 3]
        if float(training_quality(window, self._known).max()) < FOUND:
            self._lose(place)
            return True
        place.retune(self._hz(equaliser.turn), self._rate_hz)
        self._train(place, equaliser.taps)
        return True

    def _ready(self, place: _Place, *, last: bool) -> int:
        """Blocks that can be received now."""
        length = self._profile.code_length
        wanted = min(CHUNK_BLOCKS, self._blocks_left) if self._profile.qam_blocks else CHUNK_BLOCKS
        if self._within(place, wanted * length, last=False):
            return wanted
        left = int((len(self._buffer) - place.position) / place.samples_per_symbol + TAIL) // length
        return min(wanted, max(left, 0)) if last else 0

    def _chunk(self, place: _Place, equaliser: QamFilter, blocks: int) -> list[Demodulation]:
        """Some blocks; nothing where they are no signal."""
        length, before = self._profile.code_length, copy.deepcopy(equaliser)
        window = self._window(place, 0.0, blocks * length)
        points = equaliser.run(window, blocks * length)
        spacing = float(np.diff(levels(self._profile.qam_order)[:2])[0])
        error = np.abs(points - nearest(points, self._profile.qam_order)) ** 2
        garbage = error.reshape(blocks, length).mean(axis=1) / (spacing**2 / 6.0)
        # The signal may end within: blocks up to the greatest sum of what speaks for them.
        sums = np.cumsum(GARBAGE - garbage)
        count = int(np.argmax(sums)) + 1 if sums.max() > 0.0 else 0
        found: list[Demodulation] = []
        if count:
            level_db = 10.0 * float(np.log10(0.5 * np.mean(np.abs(window) ** 2) + 1e-20))
            evm_db = 10.0 * float(np.log10(np.mean(error[: count * length]) + 1e-12))
            found = [self._given(place, equaliser, points[: count * length], level_db, evm_db)]
            self._poor = 0
            self._follow(place, equaliser, blocks)
        else:
            self._poor += 1
            self._filter = before
        place.position += blocks * length * place.samples_per_symbol
        self._blocks_left = max(0, self._blocks_left - blocks)
        if self._poor >= LOST_CHUNKS:
            self._lose(place)
        return found

    def _follow(self, place: _Place, equaliser: QamFilter, blocks: int) -> None:
        """Let clock and place follow what the taps' delay says."""
        drift = self._tracker.step(equaliser.taps.forward.reshape(-1, 2).T).delay_chips
        place.position += drift * place.samples_per_symbol
        place.samples_per_symbol *= 1.0 + CLOCK_GAIN * drift / (blocks * self._profile.code_length)
        equaliser.advance(drift)

    def _lose(self, place: _Place) -> None:
        self._drop(int(np.clip(place.position - 2 * CHUNK_BLOCKS * self._per_symbol, 0, len(self._buffer))))
        self._place = self._filter = None
        self._losses += 1

    def _given(
        self, place: _Place, equaliser: QamFilter, points: NDArray[np.complex128], level_db: float, evm_db: float
    ) -> Demodulation:
        profile = self._profile
        soft = despread_symbols(points, profile)
        count, per_block = len(soft), profile.bits_per_block
        per_bit = place.samples_per_symbol * profile.code_length / per_block
        begin = place.position + self._dropped
        if self._last is not None and begin - self._last > per_bit * per_block + len(self._known) * self._per_symbol:
            # Bits were lost: numbers go on by time, in whole blocks, and at least one is left out.
            self._number += max(1, round((begin - self._last) / (per_bit * per_block))) * per_block
        offset_hz = place.carrier_hz - profile.carrier_hz + self._hz(equaliser.turn)
        found = Demodulation(
            symbol=self._number + np.arange(count, dtype=np.int64),
            sample=begin + per_bit * np.arange(count, dtype=np.float64),
            bit=(soft < 0.0).astype(np.int8),
            soft=soft,
            level_db=np.full(count, level_db),
            evm_db=np.full(count, evm_db),
            carrier_offset_hz=np.full(count, offset_hz),
            clock_offset_ppm=np.full(count, (self._per_symbol / place.samples_per_symbol - 1.0) * 1e6),
            receiver=self._name,
            taps=np.concatenate([equaliser.taps.forward, equaliser.taps.feedback]),
            error_db=np.array([evm_db]),
            constellation=points,
            sync=None,
            losses=self._losses,
        )
        self._number += count
        self._last = begin + per_bit * count
        return found

    def _drop(self, count: int) -> None:
        self._buffer = self._buffer[count:]
        self._dropped += count
        if self._place is not None:
            self._place.position -= count
            self._place.phase_turns = (self._place.phase_turns + self._place.carrier_hz / self._rate_hz * count) % 1.0

    def _forget(self) -> None:
        """Keep no more than the next window and the filter's reach need."""
        if self._place is not None:
            keep = 2 * FORWARD_TAPS * self._per_symbol + self._front_end.reach
            self._drop(max(0, int(self._place.position - keep)))
