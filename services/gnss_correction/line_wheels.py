"""What speed by the wheels tells the line filter at each step: how the speed changed, and what it is."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from services.gnss_correction.line_coasting import WHEEL_SIGMA_MPS
from services.gnss_correction.solver_arrays import Float64s
from services.gnss_correction.wheel_speed import WheelScale

FASTEST_CHANGE_MPS2: Final = 2.5
"""A faster change of the wheels' speed is slip or slide."""
DIRECTION_KNOWN_MPS: Final = 0.4
"""Below this speed the direction of running is not known, and the wheels do not tell it."""
RENEWAL_S: Final = 5.0
"""The wheels' error lasts: in this time they tell their speed once."""
NO_WHEEL: Final = np.array([np.nan, np.nan])


class Wheels:
    """The wheels of one train."""

    def __init__(self) -> None:
        """Know no speed yet."""
        self.scale = WheelScale()
        self._before_mps = math.nan

    def rolled_mps(self, wheel_mps: float) -> float:
        """Speed by the wheels, set right by their scale; NaN where there is none."""
        return wheel_mps * self.scale.scale

    def change_mps(self, wheel_mps: float, dt_s: float) -> float:
        """Change of speed since the call before; NaN where the wheels do not tell it."""
        now_mps = self.rolled_mps(wheel_mps)
        change_mps = now_mps - self._before_mps
        self._before_mps = now_mps
        return change_mps if abs(change_mps) <= FASTEST_CHANGE_MPS2 * dt_s else math.nan

    def measurement(self, wheel_mps: float, dt_s: float, known_mps: float) -> Float64s:
        """Speed without a sign and its variance, for one step of `dt_s` of a train that ran at `known_mps`."""
        rolled_mps = self.rolled_mps(wheel_mps)
        starts = abs(known_mps) < DIRECTION_KNOWN_MPS < rolled_mps
        if not math.isfinite(rolled_mps) or starts:
            return NO_WHEEL
        variance = WHEEL_SIGMA_MPS**2 + (self.scale.sigma * rolled_mps) ** 2
        return np.array([rolled_mps, variance * max(RENEWAL_S / dt_s, 1.0)])
