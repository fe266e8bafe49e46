"""What every receiver takes and gives."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class ReceiverRefusedError(ValueError):
    """A receiver that cannot work with this profile; the message gives the reason."""


@dataclass(frozen=True, slots=True)
class Burst:
    """Consecutive symbols in complex baseband at two samples per chip, in time with the chips."""

    samples: NDArray[np.complex128]
    """Shape (2 (LEAD + symbols x code length + TAPS),): begins LEAD chips before the first symbol's nominal place."""
    pilots: NDArray[np.float64]
    """CH2's symbols, +1 or -1, shape (symbols,)."""
    known: NDArray[np.float64] | None = None
    """CH1's symbols where they are known in training (preamble, trial run), 0 where not; same shape."""


@dataclass(frozen=True, slots=True)
class Reception:
    """What a receiver makes of a burst."""

    soft: NDArray[np.float64]
    """CH1 per symbol: +1 would be a perfect bit 0, -1 a perfect bit 1."""
    constellation: NDArray[np.complex128]
    """The same before the decision, complex; without fault ±1."""
    evm_db: float
    """Root mean square distance of the constellation from ±1."""
    taps: NDArray[np.complex128]
    """Equaliser coefficients, or the channel's response where the receiver estimates that."""
    error_db: NDArray[np.float64]
    """Mean square error of the training, per symbol or per round."""


class Receiver(Protocol):
    """One way to get CH1 out of a burst; keeps what it learned from burst to burst."""

    @property
    def name(self) -> str:
        """As `receiver_named` knows it."""
        ...

    def receive(self, burst: Burst) -> Reception:
        """Decide a burst and learn from it."""
        ...

    def copied(self) -> Receiver:
        """Another one that knows the same: what either learns from now on, the other does not."""
        ...


@dataclass(frozen=True, slots=True)
class StoredTaps:
    """Coefficients of a trial run, with which a receiver may begin."""

    receiver: str
    """Which kind of receiver they were learned with."""
    taps: NDArray[np.complex128]
    """In the shape of that receiver's `Reception.taps`."""
    mse: float = 0.0
    """Mean square error that they reached, relative to ±1."""
    symbols: int = 0
    """Trained with."""


@dataclass(frozen=True, slots=True)
class Synchronisation:
    """Where the symbols are."""

    position: float
    """Sample at which the first symbol begins."""
    samples_per_chip: float
    carrier_hz: float
    phase_turns: float
    """Of the carrier at sample 0."""
    pilot: int
    """Number of the pilot bit of the first symbol."""
    quality: float
    """Power of the correlation peak relative to its expectation without signal."""


@dataclass(frozen=True, slots=True)
class Demodulation:
    """All symbols of a recording, and how they were received. Arrays per symbol have one common length."""

    symbol: NDArray[np.int64]
    """Number of the symbol, counted with the pilot bits from their first on."""
    sample: NDArray[np.float64]
    """Sample at which it begins."""
    bit: NDArray[np.int8]
    soft: NDArray[np.float64]
    """+1 is a perfect bit 0, -1 a perfect bit 1."""
    level_db: NDArray[np.float64]
    """CH2's power relative to full scale ±1."""
    evm_db: NDArray[np.float64]
    """Of the block in which the symbol stood."""
    carrier_offset_hz: NDArray[np.float64]
    clock_offset_ppm: NDArray[np.float64]
    receiver: str
    taps: NDArray[np.complex128]
    """The last ones."""
    error_db: NDArray[np.float64]
    constellation: NDArray[np.complex128]
    sync: Synchronisation | None
    """The first one found; None: no signal of this profile."""
    refused: str = ""
    """Why nothing was received, in words."""
    losses: int = 0
    """How often synchronisation was lost and sought anew."""
    blanked: int = 0
    """Samples taken out as impulses."""
    lines_hz: tuple[float, ...] = field(default=())
    """Interfering tones taken out."""


def nothing_received(
    receiver: str, refused: str, sync: Synchronisation | None = None, losses: int = 0, blanked: int = 0
) -> Demodulation:
    """No symbols, and why."""
    none = np.empty(0)
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
        sync=sync,
        refused=refused,
        losses=losses,
        blanked=blanked,
    )
