"""Faults that are on at a time: those with times of a scenario, and those switched live."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Final

from schemas.position import FaultKind
from services.simulator.motion_state import Command
from services.simulator.radio_faults import ANYWHERE, USUAL_RADIO, Befalls, RadioFault
from services.simulator.train_scenario import TimedFault

USUAL: Final[dict[FaultKind, float]] = {
    "slide": 3.0,
    "spin": 3.0,
    "micro_slip": 0.02,
    "gnss_lost": 1.0,
    "gyro_bias": 0.005,
    "accelerometer_bias": 0.2,
    "imu_frozen": 1.0,
    "imu_lost": 1.0,
    "imu_saturated": 0.5,
    "imu_axes_swapped": 1.0,
    "imu_late": 2.0,
    "tacho_stuck": 1.0,
    "tacho_lost": 1.0,
    "tacho_missing_teeth": 9.0,
    "tacho_reset": 1.0,
    "tacho_late": 2.0,
    "radio_interference": USUAL_RADIO["radio_interference"],
    "radio_obstruction": USUAL_RADIO["radio_obstruction"],
    "radio_snow": USUAL_RADIO["radio_snow"],
    "radio_degradation": USUAL_RADIO["radio_degradation"],
    "radio_dead": USUAL_RADIO["radio_dead"],
}
"""Magnitude when none is given: m/s of the wheel against the train; share of speed (`micro_slip`); rad/s; m/s²;
largest reading as a share of the sensor's span in m/s² and rad/s (`imu_saturated`: of 9.8 m/s² and 0.1 rad/s);
seconds (`_late`); teeth; of the radios as there; 1 where there is nothing to measure."""


@dataclass(frozen=True, slots=True)
class Switched:
    """A fault that is on."""

    magnitude: float
    until_s: float
    since_s: float = 0.0
    befalls: Befalls = ANYWHERE


class FaultBoard:
    """Which faults are on."""

    def __init__(self, timed: tuple[TimedFault, ...] = ()) -> None:
        """Take the scenario's faults; they come on by themselves."""
        self._timed = sorted(timed, key=lambda fault: fault.at_s)
        self._on: dict[FaultKind, Switched] = {}

    def switch(
        self,
        kind: FaultKind,
        *,
        now_s: float,
        magnitude: float | None,
        seconds: float | None,
        befalls: Befalls = ANYWHERE,
    ) -> None:
        """Switch a fault on, in place of one of its kind; times since the start."""
        size = USUAL[kind] if magnitude is None else magnitude
        self._on[kind] = Switched(size, inf if seconds is None else now_s + seconds, now_s, befalls)

    def clear(self, kind: FaultKind) -> None:
        """Switch a fault off."""
        self._on.pop(kind, None)

    def at(self, now_s: float) -> dict[FaultKind, float]:
        """Magnitudes of the faults that are on from `now_s` on, which never falls from call to call."""
        while self._timed and self._timed[0].at_s <= now_s:
            fault = self._timed.pop(0)
            self.switch(
                fault.kind, now_s=fault.at_s, magnitude=fault.magnitude, seconds=fault.seconds, befalls=fault.befalls
            )
        for kind in [kind for kind, one in self._on.items() if one.until_s <= now_s]:
            del self._on[kind]
        return {kind: one.magnitude for kind, one in self._on.items()}

    def radio(self) -> tuple[RadioFault, ...]:
        """Faults of the radios that are on, as `at` has left them; times since the start."""
        return tuple(
            RadioFault(kind, self._on[kind].magnitude, self._on[kind].befalls, self._on[kind].since_s)
            for kind in USUAL_RADIO
            if kind in self._on
        )


def command_of(faults: dict[FaultKind, float]) -> Command:
    """What the faults do to the wheel."""
    slip_mps = faults.get("spin", 0.0) - faults.get("slide", 0.0)
    return Command(slip_mps, faults.get("micro_slip", 0.0))
