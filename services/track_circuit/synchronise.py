"""Carrier, chip and symbol synchronisation from CH2, wherever a recording starts."""

from __future__ import annotations

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
LATE_SYMBOLS = 32
"""Silence at the begin of the window after which the signal is measured once more from its own begin."""
LINES = 2048
"""Of the spectrum in which the carrier is sought: an eighth of the resolution of the window."""
ABSENT = 0.4
"""Share of the mean amplitude below which symbols at the begin are taken for silence."""
NEIGHBOURS = 8
"""Half chips to either side of the peak used for fine carrier and clock."""


def _code_correlation(baseband: NDArray[np.complex128], chips: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Correlation with CH2's code at every half chip."""
    sparse = np.zeros(2 * len(chips) - 1)
    sparse[::2] = chips
    return np.asarray(np.convolve(baseband, sparse[::-1], mode="valid"), np.complex128)


def _differential_search(
    correlation: NDArray[np.complex128], symbol_samples: int, pilots: NDArray[np.float64]
) -> tuple[int, int, float]:
    """Half-chip offset, pilot number of the first symbol, and quality of the best place.

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
    return int(offset), int(lag), float(quality[offset, lag])


def _stripped(
    correlation: NDArray[np.complex128], offset: int, symbol_samples: int, symbols: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.int64], float]:
    """Correlations around the peak without pilots and carrier, their symbols, and the carrier in turns per symbol.

    Without its pilots each path is a tone: the strongest line of their common spectrum is the carrier.
    """
    reach = np.arange(-NEIGHBOURS, NEIGHBOURS + 1)
    usable = np.arange(1 if offset < NEIGHBOURS else 0, len(symbols))
    usable = usable[offset + usable * symbol_samples + NEIGHBOURS < len(correlation)]
    found = correlation[offset + usable[:, None] * symbol_samples + reach] * symbols[usable][:, None]
    lines = np.sum(np.abs(np.fft.fft(found, LINES, axis=0)) ** 2, axis=1)
    turn = float(np.fft.fftfreq(LINES)[int(np.argmax(lines))])
    return found * np.exp(-2j * np.pi * turn * usable)[:, None], usable, turn


def _begin(stripped: NDArray[np.complex128]) -> int:
    """Row at which the signal begins: behind the lowest point of the summed presence."""
    mean = stripped.mean(axis=0)
    along = np.real(stripped @ np.conj(mean))
    typical = float(np.sum(along**2)) / (float(np.sum(along)) + 1e-30)
    total = np.concatenate([[0.0], np.cumsum(along - ABSENT * typical)])
    end = int(np.argmax(total - np.minimum.accumulate(total)))
    return int(np.argmin(total[: end + 1]))


def _fine(stripped: NDArray[np.complex128]) -> tuple[float, float]:
    """Rest of the carrier offset in turns per symbol, and clock drift in half chips per symbol.

    Both halves give a response each; between them lie their phase and their delay.
    """
    half = len(stripped) // 2
    early, late = stripped[:half].mean(axis=0), stripped[half : 2 * half].mean(axis=0)
    phase = np.vdot(early, late)
    late = late * np.exp(-1j * np.angle(phase))
    slope = np.gradient(0.5 * (early + late))
    delay = -float(np.vdot(slope, late - early).real) / (float(np.vdot(slope, slope).real) + 1e-30)
    return float(np.angle(phase)) / (2.0 * np.pi * half), delay / half


def acquire(
    samples: NDArray[np.float64], begin: int, profile: Profile, front_end: FrontEnd, *, again: bool = True
) -> Synchronisation | None:
    """Where the signal begins in the window that starts at sample `begin`; None when there is none to be found.

    The position is that of the strongest path's first symbol, `pilot` its number in the pilot bits. If the signal
    begins late in the window, it is measured once more from there (`again`).
    """
    length, symbol_samples = profile.code_length, 2 * profile.code_length
    step = front_end.sample_rate_hz / (2.0 * profile.chip_rate_hz)
    count = min(WINDOW_SYMBOLS * symbol_samples, int((len(samples) - begin) / step))
    if count < FEWEST_SYMBOLS * symbol_samples:
        return None
    baseband = front_end.baseband(samples, float(begin), step, count, profile.carrier_hz, 0.0)
    correlation = _code_correlation(baseband, code(length, profile.ch2_row))
    pilots = profile.pilots()
    offset, lag, quality = _differential_search(correlation, symbol_samples, pilots)
    if quality < THRESHOLD:
        return None
    symbols = pilots[(lag + np.arange(len(correlation) // symbol_samples)) % len(pilots)]
    stripped, usable, turn = _stripped(correlation, offset, symbol_samples, symbols)
    silent = _begin(stripped)
    if again and silent > LATE_SYMBOLS:
        late = int(begin + (offset + (usable[silent] - 1) * symbol_samples) * step)
        return acquire(samples, late, profile, front_end, again=False)
    if len(stripped) - silent < FEWEST_SYMBOLS:
        return None
    rest, drift = _fine(stripped[silent:])
    first = int(usable[silent]) if silent else 0
    position = begin + (offset + first * symbol_samples) * step
    carrier_hz = profile.carrier_hz + (turn + rest) * profile.symbol_rate_hz
    rows = usable[silent:] - first
    peak = stripped[silent:, NEIGHBOURS] * np.exp(-2j * np.pi * rest * rows)
    # Phase of the strongest path at `position`, then of the offset carrier as of sample 0.
    phase = float(np.angle(peak.sum())) / (2.0 * np.pi) + turn * first
    shift = (carrier_hz - profile.carrier_hz) / front_end.sample_rate_hz * position
    return Synchronisation(
        position=position,
        samples_per_chip=2.0 * step * (1.0 + drift / symbol_samples),
        carrier_hz=carrier_hz,
        phase_turns=(phase - shift) % 1.0,
        pilot=(lag + first) % len(pilots),
        quality=quality,
    )
