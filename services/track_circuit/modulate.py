"""From bits to the signal on the rail: spreading, chip shaping, carrier."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.track_circuit.profile import Profile
from services.track_circuit.walsh import code

PULSE_SPAN_CHIPS = 8
"""Root-raised-cosine chips are cut this many chips from their middle, where they are below -50 dB."""
SINGULAR = 1e-9
"""Chips around the pulse's removable singularities within which their limits stand."""


def antipodal(bits: ArrayLike) -> NDArray[np.float64]:
    """+1 for bit 0, -1 for bit 1."""
    return 1.0 - 2.0 * np.asarray(bits, np.float64)


def spread(symbols: NDArray[np.float64], chips_of_code: NDArray[np.float64]) -> NDArray[np.float64]:
    """Chips of symbols, shape (symbols x code length,)."""
    return np.outer(symbols, chips_of_code).ravel()


def chips(bits: ArrayLike, profile: Profile, first_pilot: int = 0) -> NDArray[np.float64]:
    """Sum of CH1 (`bits` on its row) and CH2 (pilot on its row), one value per chip.

    `first_pilot` is the number of the pilot bit beside the first data bit.
    """
    symbols = antipodal(bits)
    pilots = profile.pilots()
    pilot = pilots[(first_pilot + np.arange(len(symbols))) % len(pilots)]
    length = profile.code_length
    ch2 = profile.ch2_amplitude * spread(pilot, code(length, profile.ch2_row))
    return spread(symbols, code(length, profile.ch1_row)) + ch2


def root_raised_cosine(t: ArrayLike, roll_off: float) -> NDArray[np.float64]:
    """The root-raised-cosine pulse at times `t` in chips, of unit energy per chip.

    Proakis, Digital Communications, section 9.2; both removable singularities are filled with their limits.
    """
    times = np.asarray(t, np.float64)
    at_zero = np.abs(times) < SINGULAR
    at_edge = np.abs(np.abs(4.0 * roll_off * times) - 1.0) < SINGULAR
    safe = np.where(at_zero | at_edge, 0.1234, times)
    numerator = np.sin(np.pi * safe * (1.0 - roll_off)) + 4.0 * roll_off * safe * np.cos(
        np.pi * safe * (1.0 + roll_off)
    )
    pulse = numerator / (np.pi * safe * (1.0 - (4.0 * roll_off * safe) ** 2))
    quarter = np.pi / (4.0 * roll_off)
    edge = roll_off / np.sqrt(2.0) * ((1.0 + 2.0 / np.pi) * np.sin(quarter) + (1.0 - 2.0 / np.pi) * np.cos(quarter))
    pulse = np.where(at_zero, 1.0 - roll_off + 4.0 * roll_off / np.pi, pulse)
    return np.asarray(np.where(at_edge, edge, pulse), np.float64)


def _rectangular(values: NDArray[np.complex128], starts: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Mean over each sample interval of a staircase of chips; `starts` are interval bounds in chips."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    whole = np.clip(starts, 0.0, float(len(values)))
    at_bounds = np.interp(whole, np.arange(len(total)), total.real) + 1j * np.interp(
        whole, np.arange(len(total)), total.imag
    )
    return np.asarray(np.diff(at_bounds) / np.diff(starts), np.complex128)


def shaped(
    values: NDArray[np.float64] | NDArray[np.complex128],
    profile: Profile,
    sample_rate_hz: float,
    delay_chips: float = 0.0,
) -> NDArray[np.complex128]:
    """Complex baseband of chips at `sample_rate_hz`; the first chip begins `delay_chips` after the first sample.

    Rectangular chips are averaged over each sample interval, so that edges between samples keep their place.
    """
    chips_per_sample = profile.chip_rate_hz / sample_rate_hz
    count = int(np.ceil((len(values) + delay_chips) / chips_per_sample))
    source = np.asarray(values, np.complex128)
    if profile.pulse == "rectangular":
        bounds = (np.arange(count + 1, dtype=np.float64) - 0.5) * chips_per_sample - delay_chips
        return _rectangular(source, bounds)
    times = np.arange(count) * chips_per_sample - delay_chips - 0.5
    nearest = np.rint(times).astype(np.int64)
    padded = np.concatenate([np.zeros(PULSE_SPAN_CHIPS + 1), source, np.zeros(PULSE_SPAN_CHIPS + 1)])
    found = np.zeros(count, np.complex128)
    for offset in range(-PULSE_SPAN_CHIPS, PULSE_SPAN_CHIPS + 1):
        index = np.clip(nearest + offset, -PULSE_SPAN_CHIPS - 1, len(source) + PULSE_SPAN_CHIPS)
        found += padded[index + PULSE_SPAN_CHIPS + 1] * root_raised_cosine(times - index, profile.roll_off)
    return found


def passband(
    baseband: NDArray[np.complex128], carrier_hz: float, sample_rate_hz: float, phase_rad: float = 0.0
) -> NDArray[np.float64]:
    """Real samples: the baseband on its carrier."""
    turns = np.arange(len(baseband)) * (carrier_hz / sample_rate_hz)
    return np.asarray((baseband * np.exp(1j * (2.0 * np.pi * (turns % 1.0) + phase_rad))).real, np.float64)


def modulate(bits: ArrayLike, profile: Profile, sample_rate_hz: float, first_pilot: int = 0) -> NDArray[np.float64]:
    """The transmitted signal of data bits with their pilots; amplitude 1 per channel."""
    return passband(
        shaped(chips(bits, profile, first_pilot), profile, sample_rate_hz), profile.carrier_hz, sample_rate_hz
    )
