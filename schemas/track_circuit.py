"""Messages of track circuits: samples, telegrams, the equaliser's state, occupied or clear, health.

A circuit is received by the wayside (at its receiving end) or on board (whose circuit is occupied by the train
itself); the keys of both are alike. Complex numbers are baseband relative to the profile's carrier.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from schemas.arrays import Complex128s, Float32s, Float64s
from schemas.message import Message, Part

Scheme = Literal["ss-cdma", "cdma-qam", "fsk"]
Ratio = Annotated[float, Meta(ge=0.0, le=1.0)]


class SampleBlock(Message, frozen=True, kw_only=True):
    """Samples of one channel of a converter; `t_ns` is the time of the first one."""

    first_sample: Annotated[int, Meta(ge=0)]
    """Number of the first sample since the converter started: a jump is a gap."""
    sample_rate_hz: Annotated[float, Meta(gt=0.0)]
    samples: Float32s
    """Shape (n,); full scale is ±1."""
    clipped: int = 0
    """How many of them stand at full scale."""

    def __post_init__(self) -> None:
        """Refuse anything but one row of numbers."""
        if self.samples.ndim != 1 or self.samples.dtype != np.dtype(np.float32):
            msg = f"samples must be one row of float32, not shape {self.samples.shape} of {self.samples.dtype}"
            raise ValueError(msg)


class Telegram(Message, frozen=True, kw_only=True):
    """A telegram, or what came in its place; `t_ns` is when its first symbol was received."""

    circuit: str
    """As the receiver was set; `circuit_id` says what the telegram itself names."""
    scheme: Scheme
    state: Literal["good", "bad_crc", "other_circuit", "repeated", "old", "unconfirmed"]
    """`good` alone may be acted upon. `old`: its sequence was heard before or too long ago."""
    sequence: int | None = None
    circuit_id: int | None = None
    payload: bytes = b""
    crc_ok: bool
    evm_db: float | None = None
    """Error vector magnitude of its symbols."""
    level_db: float
    """Of the received signal, relative to full scale."""
    receiver: str = ""
    """Which equaliser decided."""


class CodedCarrier(Message, frozen=True, kw_only=True):
    """What a frequency-coded circuit sends: carrier and low-frequency code."""

    circuit: str
    state: Literal["good", "no_signal", "unknown_code", "doubtful"]
    carrier_hz: float | None = None
    code_hz: float | None = None
    meaning: str = ""
    """By the code table; empty when the code is not in it."""
    level_db: float
    margin_db: float | None = None
    """By how much the code stands above the next likely one."""


class EqualiserState(Message, frozen=True, kw_only=True):
    """How a receiver stands, decimated for people to look at."""

    circuit: str
    receiver: str
    taps: Complex128s
    error_db: Float64s
    """Mean square error over the symbols since the start or the last training."""
    constellation: Complex128s
    """Some of the latest symbols before decision."""
    snr_db: float | None = None
    carrier_offset_hz: float
    clock_offset_ppm: float
    from_store: bool
    """It began with stored coefficients."""
    refused: str = ""
    """Why the configured receiver cannot work, in words."""


class CircuitOccupancy(Message, frozen=True, kw_only=True):
    """Occupied or clear. Whatever is not certain to be clear is occupied."""

    circuit: str
    state: Literal["clear", "occupied"]
    reason: str
    level_db: float | None = None
    reference_db: float | None = None
    """Level of the clear circuit, followed slowly."""
    most_restrictive: bool
    """No valid telegram in time: the most restrictive aspect holds."""
    since_ns: int


class CircuitHealth(Message, frozen=True, kw_only=True):
    """Condition of one circuit, and where it is going."""

    circuit: str
    level_db: float | None = None
    level_trend_db_per_day: float | None = None
    ballast_s_per_km: float | None = None
    """Estimated leakage."""
    tap_drift: Ratio | None = None
    """Distance of the taps from the stored ones, relative to their size."""
    evm_db: float | None = None
    telegrams: int = 0
    """Good ones since the start."""
    crc_failures: int = 0
    stored_version: int | None = None
    """Of the coefficients begun with; None without."""


class CircuitEvent(Message, frozen=True, kw_only=True):
    """Something that people should know about a circuit."""

    circuit: str
    kind: Literal[
        "occupied",
        "cleared",
        "telegrams_lost",
        "telegrams_back",
        "trend",
        "interference",
        "samples",
        "refused",
        "trained",
    ]
    text: str
    level_db: float | None = None


class ClearConfirmation(Message, frozen=True, kw_only=True):
    """A person's word that a circuit is clear now, after a start or when weather moved its level under a train."""

    circuit: str
    by: str = ""
    """Who says so."""


class StoredCoefficients(Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Coefficients learned in a trial run."""

    circuit: Annotated[str, Meta(min_length=1, max_length=64)]
    distance_bin_m: tuple[float, float] | None = None
    """On board: stretch of the circuit, by distance from its sending end. None: the whole circuit."""
    receiver: str
    """Kind of receiver that learned them, and that may begin with them."""
    profile_digest: str
    """Of the profile that they were learned for; another profile may not use them."""
    version: Annotated[int, Meta(ge=1)] = 1
    """Counts up with every training of this circuit and stretch."""
    trained: str
    """Day of the trial run, ISO 8601."""
    weather: str = ""
    taps: tuple[tuple[float, float], ...]
    """Real and imaginary parts, in the receiver's own order."""
    level_db: float
    """Of the signal in the trial run, relative to full scale."""
    mse: Annotated[float, Meta(ge=0.0)]
    """Mean square error that they reached, relative to ±1."""
    symbols: Annotated[int, Meta(ge=1)]
    """Trained with."""

    def __post_init__(self) -> None:
        """Refuse numbers that are none, stretches that are none, and no taps."""
        numbers = (self.level_db, self.mse, *(self.distance_bin_m or ()), *(x for pair in self.taps for x in pair))
        if not self.taps or not all(math.isfinite(number) for number in numbers):
            msg = f"coefficients of {self.circuit}: no taps, or numbers that are not finite"
            raise ValueError(msg)
        if self.distance_bin_m is not None and not self.distance_bin_m[0] < self.distance_bin_m[1]:
            msg = f"coefficients of {self.circuit}: the stretch {self.distance_bin_m} has no length"
            raise ValueError(msg)


class CoefficientStore(Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The file of all coefficients of a place, kept by the service and by `kirotei track-circuit train`."""

    version: Literal[1] = 1
    """Of this form of file."""
    sets: tuple[StoredCoefficients, ...] = ()
