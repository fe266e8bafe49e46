"""CDMA-QAM: CDMA on I and on Q of a QAM signal (Arai et al., section 3; Mochizuki et al. 2006).

Three codes on I and three on Q sum to four levels each, the points of 16-QAM; seven to eight levels, those of 64-QAM.
Known symbols come first; they are the equaliser's training and the mark of the frame's begin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.modulate import antipodal, passband, shaped
from services.track_circuit.profile import QAM_CODES, Profile, ProfileError
from services.track_circuit.qam import bits_per_symbol, levels, qam_points
from services.track_circuit.walsh import hadamard


def codes_of(profile: Profile) -> NDArray[np.float64]:
    """The codes in use, shape (codes, code length). Raises ProfileError when the profile has too few."""
    count = QAM_CODES[profile.qam_order]
    rows = profile.qam_rows[:count]
    if len(set(rows)) < count or max(rows) > profile.code_length:
        msg = f"qam_rows {profile.qam_rows}: {profile.qam_order}-QAM needs {count} rows of 1 to {profile.code_length}"
        raise ProfileError(msg)
    return np.asarray(hadamard(profile.code_length)[[row - 1 for row in rows]], np.float64)


def training_symbols(profile: Profile) -> NDArray[np.complex128]:
    """The known symbols ahead of the data, from the pilot generator."""
    bits = profile.pilot_generator.bits(profile.qam_training * bits_per_symbol(profile.qam_order))
    return qam_points(bits, profile.qam_order)


def spread_symbols(bits: NDArray[np.int8], profile: Profile) -> NDArray[np.complex128]:
    """QAM symbols of bits: per block the codes of I, then those of Q. Raises ValueError for an incomplete block."""
    codes = codes_of(profile)
    if len(bits) % profile.bits_per_block:
        msg = f"{len(bits)} bits are no multiple of the {profile.bits_per_block} of a block"
        raise ValueError(msg)
    signs = antipodal(bits).reshape(-1, 2, len(codes))
    grid = levels(profile.qam_order)
    chips = signs @ codes * (0.5 * (grid[1] - grid[0]))
    return np.asarray((chips[:, 0] + 1j * chips[:, 1]).ravel(), np.complex128)


def despread_symbols(symbols: NDArray[np.complex128], profile: Profile) -> NDArray[np.float64]:
    """Soft bits of whole blocks: +1 is a perfect bit 0."""
    codes = codes_of(profile)
    grid = levels(profile.qam_order)
    blocks = symbols.reshape(-1, profile.code_length) @ codes.T / (profile.code_length * 0.5 * (grid[1] - grid[0]))
    return np.ascontiguousarray(np.stack([blocks.real, blocks.imag], axis=1)).ravel()


def modulate_cdma_qam(bits: NDArray[np.int8], profile: Profile, sample_rate_hz: float) -> NDArray[np.float64]:
    """The transmitted signal: training, then the bits; training again before each frame where there are frames."""
    known, data = training_symbols(profile), spread_symbols(bits, profile)
    size = profile.qam_blocks * profile.code_length or len(data)
    frames = [np.concatenate([known, data[begin : begin + size]]) for begin in range(0, len(data), max(size, 1))]
    return passband(shaped(np.concatenate(frames), profile, sample_rate_hz), profile.carrier_hz, sample_rate_hz)


def training_quality(baseband: NDArray[np.complex128], known: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Squared correlation with the training at every half symbol, relative to its greatest possible."""
    sparse = np.zeros(2 * len(known) - 1, np.complex128)
    sparse[::2] = known
    correlation = np.abs(np.correlate(baseband, sparse, "valid")) ** 2
    window = np.zeros(len(sparse))
    window[::2] = 1.0
    power = np.convolve(np.abs(baseband) ** 2, window, "valid") * float(np.sum(np.abs(known) ** 2))
    return np.asarray(correlation / (power + 1e-3 * float(power.max(initial=0.0)) + 1e-30), np.float64)
