"""What is wrong with a pulse counter: stuck while the vehicle moves, begun anew, out of step with another axle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

STUCK_S: Final = 5.0
_SHAKES: Final = 3.0
"""A vehicle that runs shakes its inertial sensor by this much more than at its quietest."""
_SHAKES_AT_LEAST_MPS2: Final = 0.05
RECENT_S: Final = 60.0
STEP_M: Final = 1000.0
SCALE_SHARE: Final = 0.015
"""Wheels of one vehicle are turned to within 1 % of each other; one missing tooth of 90 is 1.1 %."""


@dataclass(slots=True)
class StuckWatch:
    """Finds a counter that stands still while the inertial sensor shakes as in running."""

    _pulses: int | None = None
    _since_s: float = 0.0
    _quietest_mps2: float = float("inf")

    def fault(self, pulses: int, shake_mps2: float | None, time_s: float) -> str:
        """In words, or empty. `shake_mps2`: spread of the vertical acceleration over the last second."""
        if self._pulses is None or pulses != self._pulses:
            self._pulses, self._since_s = pulses, time_s
        if shake_mps2 is None:
            return ""
        self._quietest_mps2 = min(self._quietest_mps2, shake_mps2)
        least = max(_SHAKES * self._quietest_mps2, _SHAKES_AT_LEAST_MPS2)
        if shake_mps2 < least:
            self._since_s = time_s
        if time_s - self._since_s < STUCK_S:
            return ""
        return f"no pulse for {time_s - self._since_s:.0f} s while the vehicle shakes as in running"


@dataclass(slots=True)
class Recently:
    """Whether something that is counted has happened again within the last minute."""

    _count: int = 0
    _since_s: float = float("-inf")

    def grown(self, count: int, time_s: float) -> bool:
        """Take a count; True for RECENT_S after it grew."""
        if count > self._count:
            self._count, self._since_s = count, time_s
        return time_s - self._since_s < RECENT_S


@dataclass(slots=True)
class AxlePair:
    """Compares the distances of two axles kilometre by kilometre; slips of one of them are shorter than that."""

    _first_m: float | None = None
    _second_m: float = 0.0
    _fault: str = ""

    def fault(self, first_m: float, second_m: float) -> str:
        """In words, or empty; of cumulative distances of both axles [m]."""
        if self._first_m is None:
            self._first_m, self._second_m = first_m, second_m
        gone_m, other_m = first_m - self._first_m, second_m - self._second_m
        if max(abs(gone_m), abs(other_m)) < STEP_M:
            return self._fault
        share = (other_m - gone_m) / max(abs(gone_m), abs(other_m))
        self._fault = (
            f"over {gone_m:.0f} m this axle counted {100.0 * share:+.1f} % against the first: "
            "missing teeth, a wrong wheel diameter, or a long slip"
            if abs(share) > SCALE_SHARE
            else ""
        )
        self._first_m, self._second_m = first_m, second_m
        return self._fault
