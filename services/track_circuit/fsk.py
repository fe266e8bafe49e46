"""Carrier and low-frequency code of frequency-coded circuits (UM71, ZPW-2000), a window at a time.

The carrier swings between f + shift and f - shift with the code's square wave, its phase continuous. Such a signal is
a comb of lines f + k m with known complex amplitudes c_k (m the code), up to one gain, the code's own phase and the
carrier's. A window is compared with the comb of every code:
    fit(m) = max over theta |sum_k conj(c_k exp(j k theta)) X_k|^2 / sum_k |c_k|^2
Lines beside the carrier alone decide whether a code is there at all, so that a bare tone decodes to nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.code_table import CodeTable

WINDOW_S = 2.0
"""Resolves codes 1.1 Hz apart: a Hann window's first zero is 2 / WINDOW_S = 1 Hz away."""
SHORTEST_S = 1.9
BASEBAND_HZ = 256.0
"""Rate of the decimated carrier band: three lines to either side of 29 Hz fit."""
GRID_HZ = 0.05
LINES = 3
"""Lines to either side; with shift over code below 1.1 those beyond hold less than 1 % of the power."""
REACH_HZ = 3.5
"""Carriers are sought so far from the nominal one."""
PHASES = 48
PRESENT = 12.0
"""Power of the strongest line over noise, from which on something is there."""
CODED = 27.0
"""Least power of the lines beside the carrier over noise: exp(-27) for each of some 1e4 combs tried, 2e-8 a window."""
LIKENESS = 0.7
"""Least share of the lines' power that the comb explains."""
MARGIN_DB = 3.0
"""Least distance of the next likely code."""


State = Literal["good", "no_signal", "unknown_code", "doubtful"]


@dataclass(frozen=True, slots=True)
class Coded:
    """What stands around one carrier in one window."""

    state: State
    carrier_hz: float | None = None
    code_hz: float | None = None
    """By the table where it is known, as measured where not."""
    level_db: float = -200.0
    """Of the whole signal, relative to a full-scale sine's 0 dB - 3 dB = -3 dB."""
    margin_db: float | None = None
    reason: str = ""


@lru_cache(maxsize=4096)
def comb(shift_hz: float, code_hz: float) -> tuple[complex, ...]:
    """Amplitudes c_-3 … c_3 of a carrier of amplitude 1, keyed by a square wave of `code_hz` to ± `shift_hz`."""
    points = 512
    t = (np.arange(points) + 0.5) / points
    swing = np.where(t < 0.5, t, 1.0 - t)  # noqa: PLR2004 - half a period up, half a period down
    wave = np.exp(2j * np.pi * shift_hz / code_hz * swing)
    k = np.arange(-LINES, LINES + 1)
    return tuple((np.exp(-2j * np.pi * np.outer(k, t)) @ wave / points).tolist())


def carrier_band(samples: NDArray[np.float64], sample_rate_hz: float, carrier_hz: float) -> NDArray[np.complex128]:
    """Spectrum around a carrier, every GRID_HZ from -BASEBAND_HZ/2 on, of Hann-weighted samples.

    Its phase refers to the window's middle. A carrier of amplitude A gives A there. Raises ValueError for a rate
    that cannot carry it.
    """
    if sample_rate_hz < 2.0 * (carrier_hz + BASEBAND_HZ / 2.0):
        msg = f"{sample_rate_hz:g} samples/s cannot carry {carrier_hz:g} Hz and its band"
        raise ValueError(msg)
    count = len(samples)
    window = np.hanning(count)
    spectrum = np.fft.rfft((samples - samples.mean()) * window) * (2.0 / window.sum())
    width = round(BASEBAND_HZ * count / sample_rate_hz) // 2 * 2
    middle = round(carrier_hz * count / sample_rate_hz)
    taken = spectrum[middle - width // 2 : middle + width // 2]
    times_s = (np.arange(width) - width / 2) * (count / sample_rate_hz / width)
    shift_hz = carrier_hz - middle * sample_rate_hz / count
    # Its middle to the front: then no line's phase depends on where it stands between the grid.
    signs = np.where((np.arange(width) + middle - width // 2) % 2 == 0, 1.0, -1.0)
    baseband = np.fft.ifft(np.fft.ifftshift(taken * signs)) * width
    baseband = np.fft.fftshift(baseband) * np.exp(-2j * np.pi * shift_hz * times_s)
    size = round(width / (count / sample_rate_hz) / GRID_HZ)
    padded = np.zeros(size, np.complex128)
    padded[: width // 2] = baseband[width // 2 :]
    padded[-(width // 2) :] = baseband[: width // 2]
    return np.asarray(np.fft.fftshift(np.fft.fft(padded)) / width, np.complex128)


def _lines(band: NDArray[np.complex128], offsets_hz: NDArray[np.float64], code_hz: float) -> NDArray[np.complex128]:
    """X_k at carriers `offsets_hz` from the nominal one, shape (offsets, lines)."""
    at = offsets_hz[:, None] + code_hz * np.arange(-LINES, LINES + 1)
    index = np.rint(at / GRID_HZ).astype(np.int64) + len(band) // 2
    return np.asarray(band[index], np.complex128)


@dataclass(frozen=True, slots=True)
class _Fit:
    power: float
    """Of the whole comb."""
    beside: float
    """Of the lines beside the carrier."""
    offset_hz: float
    code_hz: float
    likeness: float


_TURNS = np.exp(-1j * np.outer(np.arange(-LINES, LINES + 1), 2.0 * np.pi * np.arange(PHASES) / PHASES))


def _fit(band: NDArray[np.complex128], offsets_hz: NDArray[np.float64], code_hz: float, shift_hz: float) -> _Fit:
    """The best comb of one code among carriers."""
    amplitudes = np.array(comb(shift_hz, code_hz))
    lines = _lines(band, offsets_hz, code_hz)
    size = float(np.sum(np.abs(amplitudes) ** 2))
    weighted = lines * np.conj(amplitudes)
    power = np.abs(weighted @ _TURNS) ** 2 / size
    row, phase = np.unravel_index(int(np.argmax(power)), power.shape)
    whole = float(power[row, phase])
    side = weighted[row].copy()
    side[LINES] = 0.0
    side_size = size - float(np.abs(amplitudes[LINES]) ** 2)
    beside = float(np.abs(side @ _TURNS[:, phase]) ** 2) / side_size
    total = float(np.sum(np.abs(lines[row]) ** 2)) + 1e-30
    return _Fit(whole, beside, float(offsets_hz[row]), code_hz, whole / total)


def _noise(band: NDArray[np.complex128]) -> float:
    """Power of noise at one place of the grid: from the median, which lines hardly move."""
    return float(np.median(np.abs(band) ** 2) / np.log(2.0)) + 1e-24


def decode(samples: NDArray[np.float64], sample_rate_hz: float, carrier_hz: float, table: CodeTable) -> Coded:
    """Carrier and code near one nominal carrier in a window of about WINDOW_S; samples have full scale ±1.

    Raises ValueError for a window that is too short, or a rate that cannot carry the carrier.
    """
    if len(samples) < SHORTEST_S * sample_rate_hz:
        msg = f"{len(samples) / sample_rate_hz:.2f} s are too short to tell codes apart ({SHORTEST_S:g} s)"
        raise ValueError(msg)
    band = carrier_band(samples, sample_rate_hz, carrier_hz)
    noise = _noise(band)
    offsets = np.arange(-REACH_HZ, REACH_HZ + 0.05, 0.1)
    fits = sorted(
        (_fit(band, offsets, code.hz, table.shift_hz) for code in table.codes), key=lambda one: one.beside, reverse=True
    )
    if fits[0].power < PRESENT * noise or fits[0].power < 1e-15:  # noqa: PLR2004 - digital silence
        return Coded("no_signal", reason="nothing above noise near the carrier")
    best = _refined(band, fits[0], table.shift_hz)
    # A measured code is compared as such; the table's neighbours then stand apart by whole codes.
    others = [one.beside for one in fits[1:]]
    margin_db = 10.0 * np.log10(best.beside / max([noise, *others]) + 1e-12)
    level_db = 10.0 * np.log10(best.power / 2.0 + 1e-20)
    return _judged(best, noise, float(margin_db), float(level_db), carrier_hz, table)


def _refined(band: NDArray[np.complex128], coarse: _Fit, shift_hz: float) -> _Fit:
    """Carrier and code to a grid step, near a coarse fit."""
    offsets = coarse.offset_hz + np.arange(-0.2, 0.21, GRID_HZ)
    near = [_fit(band, offsets, coarse.code_hz + d, shift_hz) for d in np.arange(-0.6, 0.61, GRID_HZ)]
    return max(near, key=lambda one: one.power)


def _judged(best: _Fit, noise: float, margin_db: float, level_db: float, nominal_hz: float, table: CodeTable) -> Coded:
    carrier_hz = nominal_hz + best.offset_hz
    code = min(table.codes, key=lambda one: abs(one.hz - best.code_hz))
    measured = round(float(best.code_hz), 2)
    state, reason = _state(best, noise, margin_db, abs(code.hz - best.code_hz), table)
    told_hz = None if best.beside < CODED * noise else measured if state == "unknown_code" else code.hz
    return Coded(
        state,
        carrier_hz=round(float(carrier_hz), 2),
        code_hz=told_hz,
        level_db=level_db,
        margin_db=margin_db,
        reason=reason,
    )


def _state(best: _Fit, noise: float, margin_db: float, distance_hz: float, table: CodeTable) -> tuple[State, str]:
    """The state, and what kept it from `good`. Half a grid step is allowed for rounding."""
    if best.beside < CODED * noise:
        return "doubtful", "a tone without code"
    if best.likeness < LIKENESS:
        return "doubtful", "lines that no code explains"
    if distance_hz > table.code_tolerance_hz + GRID_HZ / 2.0:
        return "unknown_code", "not in the code table"
    off_hz = min(abs(one - best.offset_hz) for one in table.carrier_offsets_hz)
    if off_hz > table.carrier_tolerance_hz + GRID_HZ / 2.0:
        return "doubtful", "carrier off the table"
    return ("doubtful", "another code is as likely") if margin_db < MARGIN_DB else ("good", "")


def strongest(found: list[Coded]) -> Coded:
    """Of several carriers: a good one before others, the louder before the softer."""
    order = {"good": 0, "unknown_code": 1, "doubtful": 2, "no_signal": 3}
    return min(found, key=lambda one: (order[one.state], -one.level_db))


def keyed(
    carrier_hz: float, code_hz: float, shift_hz: float, sample_rate_hz: float, count: int, start_s: float = 0.0
) -> NDArray[np.float64]:
    """Samples of a coded carrier of amplitude 1, the phase continuous."""
    t = start_s + np.arange(count) / sample_rate_hz
    turns = (t * code_hz) % 1.0
    swing = np.where(turns < 0.5, turns, 1.0 - turns)  # noqa: PLR2004 - half a period up, half a period down
    phase = carrier_hz * t + shift_hz / code_hz * swing
    return np.asarray(np.cos(2.0 * np.pi * (phase % 1.0)), np.float64)


def band_level_db(samples: NDArray[np.float64], sample_rate_hz: float, carrier_hz: float, width_hz: float) -> float:
    """Power within `width_hz` around a carrier, relative to full scale; quick to follow, deaf to other carriers."""
    count = len(samples)
    spectrum = np.abs(np.fft.rfft(samples * np.hanning(count))) ** 2
    middle, half = carrier_hz * count / sample_rate_hz, max(width_hz * count / sample_rate_hz / 2.0, 1.0)
    power = float(np.sum(spectrum[int(middle - half) : int(middle + half) + 1])) * 2.0 / (count * 0.375 * count)
    return float(10.0 * np.log10(power + 1e-20))
