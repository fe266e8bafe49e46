"""A stretch of chips as sent, as received and as equalised: what the second figure of Arai et al. shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.channel_estimate import LEAD, TAPS
from services.track_circuit.equaliser import HALF_CHIP_TAPS, STRIDE
from services.track_circuit.least_squares import least_squares, windows
from services.track_circuit.modulate import spread
from services.track_circuit.profile import Profile
from services.track_circuit.receiver import Burst, Demodulation, StoredTaps
from services.track_circuit.receiver_choice import receiver_named
from services.track_circuit.signal_front_end import FrontEnd
from services.track_circuit.walsh import code

TRAINED_SYMBOLS: Final = 64
SHOWN_SYMBOLS: Final = 6
LINEAR: Final = ("least-squares", "rls", "nlms", "lms")
"""Receivers whose own coefficients make chips."""


@dataclass(frozen=True, slots=True)
class Waveform:
    """Chips in a row. Sent ones are those of both channels, CH1's as decided."""

    sample: float
    """Where they begin in the stretch of samples."""
    sent: NDArray[np.float64]
    before: NDArray[np.complex128]
    """One complex gain on the sample that fits best: without an equaliser."""
    after: NDArray[np.complex128]
    equaliser: str
    before_db: float
    """Mean square error of all chips that were looked at, relative to the sent ones' power."""
    after_db: float


def _longest(found: Demodulation) -> tuple[int, int]:
    """First symbol and number of the longest row without a gap."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(found.symbol) != 1) + 1, [len(found.symbol)]])
    row = int(np.argmax(np.diff(edges)))
    return int(edges[row]), int(edges[row + 1] - edges[row])


def _error_db(chips: NDArray[np.complex128], sent: NDArray[np.float64]) -> float:
    return float(10.0 * np.log10(np.mean(np.abs(chips - sent) ** 2) / np.mean(sent**2) + 1e-12))


def one_tap(samples: NDArray[np.complex128], sent: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Chips without an equaliser: of the samples around each chip the place that fits best, with one complex gain."""
    rows = windows(samples, len(sent), HALF_CHIP_TAPS, STRIDE)
    power = np.sum(np.abs(rows) ** 2, axis=0) + 1e-30
    gains = rows.conj().T @ sent / power
    place = int(np.argmax(np.abs(gains) ** 2 * power))
    return np.asarray(gains[place] * rows[:, place], np.complex128)


def waveform(
    samples: NDArray[np.float64],
    sample_rate_hz: float,
    profile: Profile,
    found: Demodulation,
    stored: StoredTaps | None = None,
) -> Waveform | None:
    """Some symbols from the middle of the longest row received; None where fewer than TRAINED_SYMBOLS came in a row.

    `samples` are those that `found.sample` counts, full scale ±1. The equaliser is the receiver's own, trained on
    these symbols; for receivers that make no chips it is by least squares.
    """
    begin, count = _longest(found) if len(found.symbol) else (0, 0)
    if count < TRAINED_SYMBOLS:
        return None
    at = begin + (count - TRAINED_SYMBOLS) // 2
    part = slice(at, at + TRAINED_SYMBOLS)
    length = profile.code_length
    step = sample_rate_hz / profile.chip_rate_hz / (1.0 + 1e-6 * float(found.clock_offset_ppm[at]))
    front_end = FrontEnd(sample_rate_hz, profile.chip_rate_hz)
    start = float(found.sample[at]) - LEAD * step
    size = 2 * (LEAD + TRAINED_SYMBOLS * length + TAPS)
    carrier_hz = profile.carrier_hz + float(found.carrier_offset_hz[at])
    heard = front_end.baseband(np.ascontiguousarray(samples), start, step / 2.0, size, carrier_hz, 0.0)
    pilots = profile.pilots()[found.symbol[part] % len(profile.pilots())]
    decided = 1.0 - 2.0 * found.bit[part].astype(np.float64)
    sent = spread(pilots, profile.ch2_amplitude * code(length, profile.ch2_row))
    sent = sent + spread(decided, code(length, profile.ch1_row))
    name = found.receiver if found.receiver in LINEAR else LINEAR[0]
    if found.receiver in LINEAR:
        taps = receiver_named(name, profile, stored).receive(Burst(heard, pilots)).taps
    else:
        taps = least_squares(heard, sent.astype(np.complex128), HALF_CHIP_TAPS, STRIDE)
    after = windows(heard, len(sent), len(taps), STRIDE) @ taps
    before = one_tap(heard, sent)
    first = (TRAINED_SYMBOLS - SHOWN_SYMBOLS) // 2 * length
    shown = slice(first, first + SHOWN_SYMBOLS * length)
    return Waveform(
        sample=float(found.sample[at]) + first * step,
        sent=sent[shown],
        before=before[shown],
        after=np.asarray(after[shown], np.complex128),
        equaliser=name,
        before_db=_error_db(before, sent),
        after_db=_error_db(np.asarray(after, np.complex128), sent),
    )
