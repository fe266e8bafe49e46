"""A complex multipath channel, bursts over it, and noise: what tests of receivers share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.channel_estimate import LEAD, TAPS
from services.track_circuit.modulate import antipodal, chips
from services.track_circuit.profile import Profile
from services.track_circuit.receiver import Burst

PROFILE = Profile()
CHANNEL = np.array([0.1j, 0.25 - 0.2j, 0.8 + 0.5j, 0.6 - 0.55j, -0.2 + 0.35j, 0.15j, -0.05 - 0.05j])
"""Half-chip spaced, first tap one chip early; conjugating it would change everything."""


def burst_of(
    bits: NDArray[np.int8], noise: float, generator: np.random.Generator, *, gain: complex = 1.0 + 0.0j
) -> Burst:
    """Bits over CHANNEL times `gain`; `noise` is the standard deviation per half chip and component."""
    count = 2 * (LEAD + len(bits) * PROFILE.code_length + TAPS)
    sparse = np.zeros(count, np.complex128)
    sparse[2 * LEAD : 2 * LEAD + 2 * len(bits) * PROFILE.code_length : 2] = chips(bits, PROFILE)
    heard = np.convolve(sparse, gain * CHANNEL)[2 : 2 + count]
    white = generator.normal(size=(2, count)) * noise
    return Burst(heard + white[0] + 1j * white[1], PROFILE.pilots()[: len(bits)])


def random_bits(count: int, generator: np.random.Generator) -> NDArray[np.int8]:
    return generator.integers(0, 2, count).astype(np.int8)


def symbols_of(bits: NDArray[np.int8]) -> NDArray[np.float64]:
    return antipodal(bits)
