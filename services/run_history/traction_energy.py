"""Traction energy of a leg from speed and acceleration (Maki et al., section 3.4), with its uncertainty.

Force = (m + rotating) a + R(v) + gradient and curves; power at the line = F v / efficiency where F drives,
counted only where it is positive. Noise in the speed would be counted as traction wherever a train coasts or
cruises; the smoother leaves little of it, and what is left is estimated from its own covariance and told.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.run_history.vehicle import Vehicle

Floats = NDArray[np.float64]
JOULE_PER_KWH: Final = 3.6e6
MASS_SHARE: Final = 0.05
"""Standard deviation of the running mass (load) that is not known better."""
RESISTANCE_SHARE: Final = 0.15
EFFICIENCY_SHARE: Final = 0.04
CORRELATION_S: Final = 5.0
"""Errors of the smoothed acceleration are alike for about so long."""


@dataclass(frozen=True, slots=True)
class Energy:
    """What a leg took from the line [kWh], traction alone, and what goes with it."""

    traction_kwh: float
    sigma_kwh: float
    """Standard deviation: errors of speed, mass, resistance and efficiency."""
    wheel_kwh: float
    """At the wheel."""
    regenerated_kwh: float
    auxiliaries_kwh: float


def traction_energy(
    vehicle: Vehicle,
    t_s: Floats,
    speed_mps: Floats,
    acceleration_mps2: Floats,
    acceleration_sigma_mps2: Floats,
    track_force_n: Floats,
) -> Energy:
    """Energy over the fixes of a leg; speeds without sign, force of the track against the motion. Shapes (n,)."""
    mass = vehicle.inertial_mass_kg
    resistance = vehicle.resistance_n(speed_mps)
    force = mass * acceleration_mps2 + resistance + track_force_n
    drives = force > 0.0
    step_s = np.diff(t_s)

    def integral(power: Floats) -> float:
        return float(np.sum(0.5 * (power[1:] + power[:-1]) * step_s)) / JOULE_PER_KWH

    wheel = integral(np.where(drives, force, 0.0) * speed_mps)
    with_mass = np.where(drives, mass * acceleration_mps2 + track_force_n, 0.0)
    mass_part = integral(with_mass * speed_mps) * MASS_SHARE
    resistance_part = integral(np.where(drives, resistance, 0.0) * speed_mps) * RESISTANCE_SHARE
    duration_s = max(float(t_s[-1] - t_s[0]), 1.0)
    noise = integral(np.where(drives, mass * acceleration_sigma_mps2, 0.0) * speed_mps)
    noise_part = noise * np.sqrt(min(1.0, CORRELATION_S / duration_s))
    spread = float(np.sqrt(mass_part**2 + resistance_part**2 + noise_part**2 + (wheel * EFFICIENCY_SHARE) ** 2))
    factor = vehicle.calibration / vehicle.line_to_wheel
    return Energy(
        traction_kwh=wheel * factor,
        sigma_kwh=spread * factor,
        wheel_kwh=wheel,
        regenerated_kwh=integral(np.where(drives, 0.0, -force) * speed_mps) * vehicle.regeneration_efficiency,
        auxiliaries_kwh=vehicle.auxiliaries_kw * duration_s / 3600.0,
    )
