"""What becomes of frames: reception and corrected bits by the ratio of signal to interference and noise."""

from __future__ import annotations

from dataclasses import dataclass
from math import erfc, exp, lgamma, log, log1p, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LOWEST_DB: Final = -10.0
HIGHEST_DB: Final = 30.0
STEP_DB: Final = 0.1


def bit_error_rate(sinr_db: float) -> float:
    """Of coherent QPSK, with Gaussian interference: ½ erfc(√(SINR / 2)) (Proakis, Digital Communications, 4.3).

    >>> round(bit_error_rate(9.8), 5)
    0.001
    """
    return 0.5 * erfc(sqrt(10.0 ** (sinr_db / 10.0) / 2.0))


@dataclass(frozen=True, slots=True, eq=False)
class FrameCode:
    """Frames of so many bits whose code corrects up to so many of them."""

    sinr_db: Floats
    received: Floats
    """Probability that a frame is received, by `sinr_db`."""
    corrected: Floats
    """Bits corrected in a frame that is received, on average."""

    def received_at(self, sinr_db: Floats) -> Floats:
        """Probability of reception."""
        return np.interp(sinr_db, self.sinr_db, self.received)

    def corrected_at(self, sinr_db: Floats) -> Floats:
        """Mean number of corrected bits."""
        return np.interp(sinr_db, self.sinr_db, self.corrected)


def frame_code(bits: int, correctable: int) -> FrameCode:
    """Tables for a code: errors of a frame are binomial, and it is received when the code can correct them all."""
    sinr_db = np.arange(LOWEST_DB, HIGHEST_DB + STEP_DB / 2, STEP_DB)
    rows = [_frame(bits, min(correctable, bits), bit_error_rate(one)) for one in sinr_db]
    received, corrected = np.array(rows).T
    return FrameCode(sinr_db, received, corrected)


def _frame(bits: int, correctable: int, rate: float) -> tuple[float, float]:
    """Probability of at most `correctable` errors, and their mean number then."""
    if rate <= 0.0:
        return 1.0, 0.0
    errors = range(correctable + 1)
    logs = [
        lgamma(bits + 1) - lgamma(k + 1) - lgamma(bits - k + 1) + k * log(rate) + (bits - k) * log1p(-rate)
        for k in errors
    ]
    chances = [exp(one) for one in logs]
    total = min(sum(chances), 1.0)
    # Where nothing is received the most likely of the correctable numbers stands for the mean.
    mean = sum(k * chance for k, chance in zip(errors, chances, strict=True)) / total if total > 0.0 else correctable
    return total, float(mean)
