"""A rail for the track-circuit measurements: two tuned units and a leaky line, its noise, and the bound beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from services.track_circuit.channel_estimate import LEAD, TAPS
from services.track_circuit.modulate import antipodal, chips, passband, shaped, spread
from services.track_circuit.profile import Profile
from services.track_circuit.signal_front_end import FrontEnd
from services.track_circuit.walsh import code

RATE_HZ = 48_000.0
PROFILE = Profile()
LEVEL_SYMBOLS = 400
"""Symbols of CH1 alone over which the energy per bit is measured."""


@dataclass(frozen=True, slots=True)
class Rail:
    """Sending and receiving tuned unit of quality `quality` at the carrier, and the line between them."""

    quality: float
    length_km: float = 0.5
    ballast_s_per_km: float = 0.1

    def response(self, frequency_hz: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Transfer function; 0 below 500 Hz, where the signal has nothing."""
        found = np.zeros(len(frequency_hz), np.complex128)
        inside = frequency_hz > 500.0  # noqa: PLR2004 - see above
        f = frequency_hz[inside]
        detuning = self.quality * (f / PROFILE.carrier_hz - PROFILE.carrier_hz / f)
        series = 0.9 * np.sqrt(f / 1000.0) + 2j * np.pi * f * 1.3e-3
        found[inside] = np.exp(-np.sqrt(series * self.ballast_s_per_km) * self.length_km) / (1.0 + 1j * detuning) ** 2
        return found

    def through(self, baseband: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Baseband around the carrier behind the rail."""
        size = 1 << math.ceil(math.log2(len(baseband) + 4096))
        frequency = np.asarray(np.fft.fftfreq(size, 1.0 / RATE_HZ) + PROFILE.carrier_hz, np.float64)
        spectrum = np.asarray(np.fft.fft(baseband, size), np.complex128) * self.response(frequency)
        return np.asarray(np.fft.ifft(spectrum)[: len(baseband)], np.complex128)


@dataclass(frozen=True, slots=True)
class Sent:
    """Bits behind a rail, scaled to one unit of energy per bit of CH1."""

    bits: NDArray[np.int8]
    samples: NDArray[np.float64]

    def noisy(self, snr_db: float, generator: np.random.Generator) -> NDArray[np.float64]:
        """With white noise; `snr_db` is energy per bit over noise density."""
        return self.samples + generator.normal(size=len(self.samples)) * math.sqrt(0.5 * 10.0 ** (-snr_db / 10.0))


def send(
    bits: NDArray[np.int8], rail: Rail, *, clock_ppm: float = 0.0, carrier_hz: float = 0.0, phase_rad: float = 0.0
) -> Sent:
    """Standard signal with another clock and carrier behind a rail."""
    moved = replace(PROFILE, chip_rate_hz=PROFILE.chip_rate_hz * (1.0 + clock_ppm * 1e-6))
    both = rail.through(shaped(chips(bits, PROFILE), moved, RATE_HZ))
    ch1 = spread(antipodal(bits[:LEVEL_SYMBOLS]), code(PROFILE.code_length, PROFILE.ch1_row))
    alone = rail.through(shaped(ch1, moved, RATE_HZ))
    energy = float(np.sum(np.abs(alone) ** 2)) / 2.0 / LEVEL_SYMBOLS
    return Sent(bits, passband(both / math.sqrt(energy), PROFILE.carrier_hz + carrier_hz, RATE_HZ, phase_rad))


def half_chips(samples: NDArray[np.float64], symbols: int) -> NDArray[np.complex128]:
    """Samples of a signal without offsets at two per chip, in the timing of a Burst."""
    front_end = FrontEnd(RATE_HZ, PROFILE.chip_rate_hz)
    step = RATE_HZ / (2.0 * PROFILE.chip_rate_hz)
    start = 2.0 * step * (1 - LEAD)
    count = 2 * (LEAD + symbols * PROFILE.code_length + TAPS)
    return front_end.baseband(np.ascontiguousarray(samples), start, step, count, PROFILE.carrier_hz, 0.0)


def half_chip_noise(count: int, snr_db: float, generator: np.random.Generator) -> NDArray[np.complex128]:
    """Noise of that ratio at two samples per chip."""
    front_end = FrontEnd(RATE_HZ, PROFILE.chip_rate_hz)
    step = RATE_HZ / (2.0 * PROFILE.chip_rate_hz)
    white = generator.normal(size=int(count * step) + 4 * front_end.reach) * math.sqrt(0.5 * 10.0 ** (-snr_db / 10.0))
    return front_end.baseband(white, float(2 * front_end.reach), step, count, PROFILE.carrier_hz, 0.0)


def tail(x: float) -> float:
    """Probability of a standard normal variable above x."""
    return 0.5 * math.erfc(x / math.sqrt(2.0))


def bound(snr_db: float) -> float:
    """Bit error rate of the matched filter without interference: BPSK in white noise."""
    return tail(math.sqrt(2.0 * 10.0 ** (snr_db / 10.0)))


def snr_of(error_rate: float) -> float:
    """The ratio in dB at which the bound has that error rate."""
    low, high = -20.0, 20.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if bound(middle) > error_rate else (low, middle)
    return 0.5 * (low + high)
