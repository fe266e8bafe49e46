"""Speed by the wheels: looked up causally, and set right by a scale that Doppler teaches."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from services.gnss_correction.solver_arrays import Float64s

OLDEST_S: Final = 0.6
"""An older wheel speed says nothing of the present."""
EARLY_S: Final = 0.005
"""Stamps of one instant, written by different means, differ by less."""
SLOWEST_TO_LEARN_MPS: Final = 3.0
LEARNING_M: Final = 3_000.0
"""Way over which the scale is averaged."""
TRUSTED_M: Final = 500.0
"""What the wheels themselves are worth beside it."""
WIDEST_SCALE: Final = 0.05
"""Worn wheels and wrong diameters come to a few per cent; more is not believed."""


@dataclass(frozen=True, slots=True)
class WheelSpeeds:
    """Speeds by the wheels, without a sign."""

    t_s: Float64s
    """Seconds of GPS time since 1980, rising."""
    speed_mps: Float64s

    def at(self, t_s: float) -> float:
        """Newest speed not after an instant [m/s]; NaN when it is older than OLDEST_S."""
        i = int(np.searchsorted(self.t_s, t_s + EARLY_S, side="right")) - 1
        if i < 0 or t_s - self.t_s[i] > OLDEST_S:
            return math.nan
        return float(abs(self.speed_mps[i]))


class WheelScale:
    """How many metres the train goes while the wheels say one: learnt from Doppler while it runs."""

    def __init__(self) -> None:
        """Believe the wheels for now."""
        self.scale = 1.0
        self.learnt_m = 0.0

    @property
    def sigma(self) -> float:
        """Standard deviation of the scale: 2 per cent at first, half a per cent at last."""
        return max(0.02 / math.sqrt(1.0 + self.learnt_m / TRUSTED_M), 0.005)

    def learn(self, doppler_mps: float, wheel_mps: float, dt_s: float) -> None:
        """Take in a speed by Doppler beside that of the wheels; contradictions (slip, slide) teach nothing."""
        if not (wheel_mps > SLOWEST_TO_LEARN_MPS and abs(doppler_mps / wheel_mps - 1.0) < 2.0 * WIDEST_SCALE):
            return
        way_m = wheel_mps * dt_s
        self.learnt_m = min(self.learnt_m + way_m, LEARNING_M)
        gain = way_m / (self.learnt_m + TRUSTED_M)
        self.scale += gain * (doppler_mps / wheel_mps - self.scale)
        self.scale = min(max(self.scale, 1.0 - WIDEST_SCALE), 1.0 + WIDEST_SCALE)
