"""Carrier, chip and symbol synchronisation from CH2, wherever a recording starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.profile import Profile
from services.track_circuit.receiver import Synchronisation
from services.track_circuit.signal_front_end import FrontEnd
from services.track_circuit.walsh import code

WINDOW_SYMBOLS = 256
"""Symbols over which the signal is sought."""
FEWEST_SYMBOLS = 12
"""Fewer are not enough to know the pilot's place beyond chance."""
THRESHOLD = 30.0
"""Least squared correlation over its mean in noise: exp(-30) per place tried, 1e-8 over 1e5 places."""
NEIGHBOURS = 8
"""Half chips to either side of the peak used for fine carrier and clock."""


def _code_correlation(baseband: NDArray[np.complex128], chips: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Correlation with CH2's code at every half chip."""
    sparse = np.zeros(2 * len(chips) - 1)
    sparse[::2] = chips
    return np.asarray(np.convolve(baseband, sparse[::-1], mode="valid"), np.complex128)


def _differential_search(
    correlation: NDArray[np.complex128], symbol_samples: int, pilots: NDArray[np.float64]
) -> tuple[int, int, complex, float]:
    """Half-chip offset, pilot number of the first symbol, sum at the peak, and quality.

    Products of neighbouring symbols know no carrier phase and hardly the carrier's offset.
    """
    count = len(correlation) // symbol_samples
    table = correlation[: count * symbol_samples].reshape(count, symbol_samples).T
    products = table[:, 1:] * np.conj(table[:, :-1])
    pattern = pilots * np.roll(pilots, -1)
    period = len(pattern)
    tiled = np.resize(pattern, period + products.shape[1])
    size = 1 << int(np.ceil(np.log2(len(tiled) + products.shape[1])))
    spectrum = np.fft.fft(tiled, size)[None, :] * np.conj(np.fft.fft(np.conj(products), size, axis=1))
    sums = np.fft.ifft(spectrum, axis=1)[:, :period]
    expected = np.sum(np.abs(products) ** 2, axis=1, keepdims=True) + 1e-30
    quality = np.abs(sums) ** 2 / expected
    power = np.abs(sums)
    power[quality.max(axis=1) < THRESHOLD] = 0.0
    offset, lag = np.unravel_index(int(np.argmax(power)), power.shape)
    return int(offset), int(lag), complex(sums[offset, lag]), float(quality[offset, lag])


def _fine(
    correlation: NDArray[np.complex128], offset: int, symbol_samples: int, symbols: NDArray[np.float64], turn: float
) -> tuple[float, float]:
    """Rest of the carrier offset in turns per symbol, and clock drift in half chips per symbol.

    Both halves of the window give a response each; between them lie their phase and their delay.
    """
    reach = np.arange(-NEIGHBOURS, NEIGHBOURS + 1)
    first = 1 if offset < NEIGHBOURS else 0
    usable = np.arange(first, len(symbols))
    index = offset + usable[:, None] * symbol_samples + reach
    usable = usable[index.max(axis=1) < len(correlation)]
    index = offset + usable[:, None] * symbol_samples + reach
    stripped = correlation[index] * (symbols[usable] * np.exp(-2j * np.pi * turn * usable))[:, None]
    half = len(usable) // 2
    early, late = stripped[:half].mean(axis=0), stripped[half : 2 * half].mean(axis=0)
    phase = np.vdot(early, late)
    late = late * np.exp(-1j * np.angle(phase))
    mean = 0.5 * (early + late)
    slope = np.gradient(mean)
    delay = -float(np.vdot(slope, late - early).real) / (float(np.vdot(slope, slope).real) + 1e-30)
    return float(np.angle(phase)) / (2.0 * np.pi * half), delay / half


def acquire(
    samples: NDArray[np.float64], begin: int, profile: Profile, front_end: FrontEnd, *, clock_ppm: float = 0.0
) -> Synchronisation | None:
    """Where the signal is in the window that starts at sample `begin`; None when there is none to be found.

    The position is that of the strongest path's first complete symbol, `pilot` its number in the pilot bits.
    """
    length = profile.code_length
    step = front_end.sample_rate_hz / (2.0 * profile.chip_rate_hz) * (1.0 + clock_ppm * 1e-6)
    available = int((len(samples) - begin) / step)
    symbol_samples = 2 * length
    count = min(WINDOW_SYMBOLS * symbol_samples, available)
    if count < FEWEST_SYMBOLS * symbol_samples:
        return None
    baseband = front_end.baseband(samples, float(begin), step, count, profile.carrier_hz, 0.0)
    correlation = _code_correlation(baseband, code(length, profile.ch2_row))
    pilots = profile.pilots()
    offset, lag, peak, quality = _differential_search(correlation, symbol_samples, pilots)
    if quality < THRESHOLD:
        return None
    turn = float(np.angle(peak)) / (2.0 * np.pi)
    symbols = pilots[(lag + np.arange(len(correlation) // symbol_samples)) % len(pilots)]
    rest, drift = _fine(correlation, offset, symbol_samples, symbols, turn)
    carrier_hz = profile.carrier_hz + (turn + rest) * profile.symbol_rate_hz
    found = Synchronisation(
        position=begin + offset * step,
        samples_per_chip=2.0 * step * (1.0 + drift / symbol_samples),
        carrier_hz=carrier_hz,
        phase_turns=0.0,
        pilot=lag,
        quality=quality,
    )
    return _without_phase(found, correlation, offset, symbol_samples, symbols, turn + rest, begin, step, profile)


def _without_phase(
    found: Synchronisation,
    correlation: NDArray[np.complex128],
    offset: int,
    symbol_samples: int,
    symbols: NDArray[np.float64],
    turn: float,
    begin: int,
    step: float,
    profile: Profile,
) -> Synchronisation:
    """`found` with the carrier's phase at sample 0, such that the strongest path comes out real and positive."""
    taken = correlation[offset::symbol_samples][: len(symbols)]
    middle = float(np.angle(np.sum(taken * symbols * np.exp(-2j * np.pi * turn * np.arange(len(taken)))))) / (2 * np.pi)
    rate_hz = profile.chip_rate_hz * 2.0 * step
    shift_turns = (found.carrier_hz - profile.carrier_hz) / rate_hz * (begin + offset * step)
    return replace(found, phase_turns=(middle - shift_turns) % 1.0)
