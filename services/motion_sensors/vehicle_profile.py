"""Vehicles whose pulse counters are known, so that a configuration names them (Iwata et al., table 2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class VehicleProfile:
    """Pulse counters of a vehicle."""

    about: str
    pulses_per_revolution: float
    wheel_diameter_m: float
    axles: tuple[str, ...]
    """Where counters sit: `driven`, `idle`, `braked`."""


PROFILES: Final = {
    "conventional": VehicleProfile(
        "three-car electric train, tachogenerator on the first driven axle", 90.0, 0.816, ("driven",)
    ),
    "axle_load_controlled": VehicleProfile(
        "single car with guide wheels, gear sensors on an idle and a braked axle", 102.0, 0.502, ("idle", "braked")
    ),
}
