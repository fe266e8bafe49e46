"""Symbols out of blocks of samples that keep coming, gaps included."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.demodulator_choice import demodulator_for
from services.track_circuit.profile import Profile
from services.track_circuit.receiver import StoredTaps

SILENT_S: Final = 0.7
"""Without symbols for longer there is no signal: three bursts."""
WORTHLESS_EVM_DB: Final = -2.0
"""Beyond this error decisions are little better than guessed, and the level is that of noise."""


@dataclass(frozen=True, slots=True)
class LivePiece:
    """Symbols in a row."""

    symbol: NDArray[np.int64]
    bit: NDArray[np.int8]
    first_sample: float
    """Where it begins, counted by the converter."""
    level_db: float | None
    """None without a signal worth the name."""
    evm_db: float
    taps: NDArray[np.complex128]
    constellation: NDArray[np.complex128]
    error_db: NDArray[np.float64]
    carrier_offset_hz: float
    clock_offset_ppm: float
    lines_hz: tuple[float, ...]
    """Foreign tones that were taken out."""


class Following:
    """One circuit's samples, block by block."""

    def __init__(self, sample_rate_hz: float, profile: Profile, receiver: str, stored: StoredTaps | None) -> None:
        """Raises ReceiverRefusedError and ValueError where the receiver cannot work with profile and rate."""
        self._rate_hz, self._profile, self._receiver, self._stored = sample_rate_hz, profile, receiver, stored
        self._demodulator = demodulator_for(sample_rate_hz, profile, receiver, stored)
        self._origin: int | None = None
        self._next_sample = 0
        self._heard_sample = 0.0
        self._losses_before = 0
        self.losses = 0

    @property
    def silent(self) -> bool:
        """No symbol has come for a while."""
        return self._next_sample - self._heard_sample > SILENT_S * self._rate_hz

    def take(self, samples: NDArray[np.float64], first_sample: int) -> list[LivePiece]:
        """Symbols that these samples complete; missing samples before them begin the search anew."""
        if self._origin is None or first_sample != self._next_sample:
            if self._origin is not None:
                self._losses_before = self.losses + 1
                self._demodulator = demodulator_for(self._rate_hz, self._profile, self._receiver, self._stored)
            self._origin = first_sample
            self._heard_sample = max(self._heard_sample, float(first_sample))
        self._next_sample = first_sample + len(samples)
        found = self._demodulator.take(samples)
        self.losses = self._losses_before + found.losses
        pieces = []
        breaks = np.flatnonzero(np.diff(found.symbol) != 1) + 1
        for part in np.split(np.arange(len(found.symbol)), breaks):
            if not len(part):
                continue
            evm_db, last = float(np.mean(found.evm_db[part])), int(part[-1])
            self._heard_sample = self._origin + float(found.sample[last])
            pieces.append(
                LivePiece(
                    symbol=found.symbol[part],
                    bit=found.bit[part],
                    first_sample=self._origin + float(found.sample[part[0]]),
                    level_db=None if evm_db > WORTHLESS_EVM_DB else float(found.level_db[last]),
                    evm_db=evm_db,
                    taps=found.taps,
                    constellation=found.constellation[part],
                    error_db=found.error_db,
                    carrier_offset_hz=float(found.carrier_offset_hz[last]),
                    clock_offset_ppm=float(found.clock_offset_ppm[last]),
                    lines_hz=found.lines_hz,
                )
            )
        return pieces
