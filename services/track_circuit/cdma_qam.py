"""CDMA-QAM: CDMA on I and on Q of a QAM signal (Arai et al., section 3; Mochizuki et al. 2006).

Three codes on I and three on Q sum to four levels each, the points of 16-QAM; seven to eight levels, those of 64-QAM.
Known symbols come first; they are the equaliser's training and the mark of the frame's begin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.modulate import antipodal, passband, shaped
from services.track_circuit.profile import Profile, ProfileError
from services.track_circuit.qam import bits_per_symbol, levels, qam_points
from services.track_circuit.qam_equaliser import LEAD, QamTaps, carrier_turn, equalise, train
from services.track_circuit.signal_front_end import FrontEnd
from services.track_circuit.walsh import hadamard

CODES = {4: 1, 16: 3, 64: 7}
"""Codes on each of I and Q by the order of the constellation: their sum has as many levels as a side has points."""
FOUND = 0.5
"""Squared correlation with the training, relative to its greatest possible, above which the frame is there."""


def codes_of(profile: Profile) -> NDArray[np.float64]:
    """The codes in use, shape (codes, code length). Raises ProfileError when the profile has too few."""
    count = CODES[profile.qam_order]
    rows = profile.qam_rows[:count]
    if len(set(rows)) < count or max(rows) > profile.code_length:
        msg = f"qam_rows {profile.qam_rows}: {profile.qam_order}-QAM needs {count} rows of 1 to {profile.code_length}"
        raise ProfileError(msg)
    return np.asarray(hadamard(profile.code_length)[[row - 1 for row in rows]], np.float64)


def bits_per_block(profile: Profile) -> int:
    """Bits that one code length of QAM symbols carries."""
    return 2 * CODES[profile.qam_order]


def training_symbols(profile: Profile) -> NDArray[np.complex128]:
    """The known symbols ahead of the data, from the pilot generator."""
    bits = profile.pilot_generator.bits(profile.qam_training * bits_per_symbol(profile.qam_order))
    return qam_points(bits, profile.qam_order)


def spread_symbols(bits: NDArray[np.int8], profile: Profile) -> NDArray[np.complex128]:
    """QAM symbols of bits: per block the codes of I, then those of Q. Raises ValueError for an incomplete block."""
    codes = codes_of(profile)
    if len(bits) % bits_per_block(profile):
        msg = f"{len(bits)} bits are no multiple of the {bits_per_block(profile)} of a block"
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
    """The transmitted frame: training, then the bits."""
    symbols = np.concatenate([training_symbols(profile), spread_symbols(bits, profile)])
    return passband(shaped(symbols, profile, sample_rate_hz), profile.carrier_hz, sample_rate_hz)


@dataclass(frozen=True, slots=True)
class QamReception:
    """A CDMA-QAM frame as received."""

    soft: NDArray[np.float64]
    """Per bit; +1 is a perfect bit 0."""
    points: NDArray[np.complex128]
    """QAM symbols before decision."""
    evm_db: float
    """Relative to the mean power of the constellation."""
    taps: QamTaps
    """As trained: what a store keeps."""
    begin: float
    """Sample at which the training begins."""


def receive_cdma_qam(
    samples: NDArray[np.float64], sample_rate_hz: float, profile: Profile, stored: QamTaps | None = None
) -> QamReception | None:
    """The first frame in a recording, equalised by decision feedback; None when there is no training to be found."""
    front_end = FrontEnd(sample_rate_hz, profile.chip_rate_hz)
    known = training_symbols(profile)
    step = sample_rate_hz / (2.0 * profile.chip_rate_hz)
    count = int(len(samples) / step)
    if count < 2 * (len(known) + profile.code_length):
        return None
    begin = -2 * LEAD
    source = np.ascontiguousarray(samples, np.float64)
    baseband = front_end.baseband(source, begin * step, step, count - 4 * begin, profile.carrier_hz, 0.0)
    place = _frame_begin(baseband, known)
    if place is None or place < 2 * LEAD:
        return None
    from_training = baseband[place - 2 * LEAD :]
    taps = train(from_training, known, stored)
    # The filters and the rail delay the signal by about a symbol: the last block ends with the samples.
    left = (count + begin - place) // 2 + 2 - begin - len(known)
    blocks = left // profile.code_length
    # The carrier's offset blurs the training: measured once, taken off, trained anew.
    per_symbol, _ = carrier_turn(from_training, known, taps)
    from_training = from_training * np.exp(-0.5j * per_symbol * np.arange(len(from_training)))
    taps = train(from_training, known, stored)
    turn = carrier_turn(from_training, known, taps)
    points = equalise(
        from_training[2 * len(known) :], taps, profile.qam_order, blocks * profile.code_length, known[::-1], turn
    )
    grid = levels(profile.qam_order)
    spacing = grid[1] - grid[0]
    rest = (points - grid[0] * (1 + 1j)) / spacing
    error = rest - np.rint(rest.real) - 1j * np.rint(rest.imag)
    evm = 10.0 * float(np.log10(np.mean(np.abs(error * spacing) ** 2) + 1e-12)) if blocks else 0.0
    return QamReception(despread_symbols(points, profile), points, evm, taps, (begin + place) * step)


def _frame_begin(baseband: NDArray[np.complex128], known: NDArray[np.complex128]) -> int | None:
    """Index of the half symbol at which the training correlates best."""
    sparse = np.zeros(2 * len(known) - 1, np.complex128)
    sparse[::2] = known
    correlation = np.abs(np.correlate(baseband, sparse, "valid")) ** 2
    window = np.zeros(len(sparse))
    window[::2] = 1.0
    power = np.convolve(np.abs(baseband) ** 2, window, "valid") * float(np.sum(np.abs(known) ** 2))
    quality = correlation / (power + 1e-3 * float(power.max()) + 1e-30)
    best = int(np.argmax(quality))
    return best if quality[best] >= FOUND else None
