"""Refusals of linear receivers that cannot work, with the reason."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.profile import Profile
from services.track_circuit.receiver import ReceiverRefusedError
from services.track_circuit.walsh import code

SHORTEST_CODE = 16
"""Chips. Flips of CH1 leave 2/N of its power in the training signal; with N = 8 that is a quarter."""
LEAST_CH1_GAIN = 0.5
"""CH1's amplitude behind the ideal filter trained on CH2, below which the row is refused."""
DESIGN_NOISE = 0.1
"""Noise per chip relative to CH1's chips, 10 dB, at which rows are judged."""
FILTER_HALF_CHIPS = 6
"""Reach to either side, in chips, of the filter that judges rows."""


def _autocorrelation(chips: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """Aperiodic autocorrelation of a code per chip at lags -reach … reach: that of random symbols on it."""
    full = np.correlate(chips, chips, "full") / len(chips)
    middle, width = len(chips) - 1, min(reach, len(chips) - 1)
    found = np.zeros(2 * reach + 1)
    found[reach - width : reach + width + 1] = full[middle - width : middle + width + 1]
    return found


def _summed(correlation: NDArray[np.float64]) -> NDArray[np.float64]:
    """The autocorrelation behind delay-and-add, two lags shorter."""
    return np.asarray(2.0 * correlation[1:-1] + correlation[:-2] + correlation[2:], np.float64)


def ch1_gain(length: int, ch2_row: int, ch1_row: int = 2) -> float:
    """CH1's amplitude behind the mean-square optimum trained on CH2 alone, on a flat channel.

    CH2 behind delay-and-add is the target; what CH1's flips leave and noise are the disturbance. Where CH2 has
    little power at CH1's frequency (half the chip rate), the filter suppresses CH1, or inverts it: gain <= 0.
    """
    reach = 2 * FILTER_HALF_CHIPS
    lags = np.arange(-reach - 1, reach + 2)
    wanted = _autocorrelation(code(length, ch2_row), reach + 1)
    other = _autocorrelation(code(length, ch1_row), reach + 1)
    noise = DESIGN_NOISE * (lags == 0)
    target, total = _summed(wanted), _summed(wanted + other + noise)
    taps = np.arange(-FILTER_HALF_CHIPS, FILTER_HALF_CHIPS + 1)
    matrix = total[reach + taps[:, None] - taps[None, :]]
    weights = np.linalg.solve(matrix, target[reach + taps])
    return float(weights @ other[1:-1][reach + taps])


def refuse_pilot_training(profile: Profile, taps_chips: float) -> None:
    """Raise ReceiverRefusedError when training on CH2 alone cannot lead to CH1.

    A filter as long as the code learns to null CH1; a short code leaves too much of CH1 in the training signal;
    rows without power near half the chip rate teach nothing about CH1's band.
    """
    length = profile.code_length
    if profile.ch1_row != 2:  # noqa: PLR2004 - the alternating row
        msg = f"CH1 is on row {profile.ch1_row}: delay-and-add cancels row 2 alone"
        raise ReceiverRefusedError(msg)
    if length < SHORTEST_CODE:
        msg = f"the code of {length} chips is too short to train on CH2 alone (at least {SHORTEST_CODE}); use mlse"
        raise ReceiverRefusedError(msg)
    if taps_chips >= length:
        msg = (
            f"an equaliser over {taps_chips:g} chips trained on CH2 alone learns to null CH1: it must be shorter than "
            f"the code of {length} chips"
        )
        raise ReceiverRefusedError(msg)
    gain = ch1_gain(length, profile.ch2_row)
    if gain < LEAST_CH1_GAIN:
        best = max(range(3, length + 1), key=lambda row: ch1_gain(length, row))
        msg = (
            f"CH2 on row {profile.ch2_row} teaches too little of CH1's band: gain {gain:.2f}, "
            f"{LEAST_CH1_GAIN} needed; the best row is {best}"
        )
        raise ReceiverRefusedError(msg)
