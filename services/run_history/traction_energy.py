"""Traction energy of a leg from speed and acceleration (Maki et al., section 3.4), with its uncertainty.

Force = (m + rotating) a + R(v) + gradient and curves; power at the line = F v / efficiency where F drives,
counted only where it is positive. Noise in the acceleration adds to that: of a force F with normal noise s the positive
part is s (φ(z) − |z| Φ(−|z|)) too large on average, z = F/s. So much is taken off, and told apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt
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
REGENERATION_SHARE: Final = 0.2
"""How much of braking is electric, and what the line takes, is known this badly."""
AUXILIARIES_SHARE: Final = 0.2
NOISE_SHARE: Final = 0.5
"""Of the correction for noise: speeds of receivers are filtered, and their noise is not white."""
CORRELATION_S: Final = 5.0
"""Errors of the smoothed acceleration are alike for about so long."""

FAR: Final = 6.0
"""Beyond so many standard deviations the excess is less than a billionth of the noise."""


@dataclass(frozen=True, slots=True)
class Energy:
    """What a leg took from the line [kWh], traction alone, and what goes with it."""

    traction_kwh: float
    sigma_kwh: float
    """Standard deviation: errors of speed, mass, resistance and efficiency."""
    wheel_kwh: float
    """At the wheel."""
    noise_kwh: float
    """What noise in the speeds would have added to the traction; it is taken off already."""
    noise_sigma_kwh: float
    regenerated_kwh: float
    """Given back to the line; not in the traction, nor are the auxiliaries."""
    regenerated_sigma_kwh: float
    auxiliaries_kwh: float
    auxiliaries_sigma_kwh: float


def traction_energy(
    vehicle: Vehicle,
    t_s: Floats,
    speed_mps: Floats,
    acceleration_mps2: Floats,
    acceleration_sigma_mps2: Floats,
    track_force_n: Floats,
    acceleration_noise_mps2: float = 0.0,
) -> Energy:
    """Energy over the fixes of a leg; speeds without sign, force of the track against the motion. Shapes (n,).

    `acceleration_sigma_mps2`: how sure the acceleration is; `acceleration_noise_mps2`: what noise of the speeds is left
    in it (`speed_noise`).
    """
    mass = vehicle.inertial_mass_kg
    resistance = vehicle.resistance_n(speed_mps)
    pulled = mass * acceleration_mps2 + track_force_n
    force = pulled + resistance
    drives = force > 0.0
    # Trapezia: each fix counts for half of the steps beside it.
    weight = np.zeros(len(t_s))
    weight[1:] = t_s[1:] - t_s[:-1]
    weight[:-1] += weight[1:]
    way_kwh = 0.5 / JOULE_PER_KWH * weight * speed_mps
    driving, braking = np.where(drives, way_kwh, 0.0), np.where(drives, 0.0, way_kwh)

    noise = float(way_kwh @ excess_of_positive_part(force, mass * acceleration_noise_mps2))
    raw = float(driving @ force)
    noise = min(noise, raw)
    wheel = raw - noise
    duration_s = max(float(t_s[-1] - t_s[0]), 1.0)
    alike = sqrt(min(1.0, CORRELATION_S / duration_s))
    unsure = float(driving @ acceleration_sigma_mps2) * mass * alike
    parts = _parts(driving, pulled, resistance)
    spread = hypot(*parts, unsure, wheel * EFFICIENCY_SHARE, noise * NOISE_SHARE)
    back = -float(braking @ force)
    back_spread = hypot(*_parts(braking, pulled, resistance), back * REGENERATION_SHARE)
    factor = vehicle.calibration / vehicle.line_to_wheel
    auxiliaries = vehicle.auxiliaries * duration_s / 3600.0
    return Energy(
        traction_kwh=wheel * factor,
        sigma_kwh=spread * factor,
        wheel_kwh=wheel,
        noise_kwh=noise * factor,
        noise_sigma_kwh=noise * factor * NOISE_SHARE,
        regenerated_kwh=back * vehicle.wheel_to_line,
        regenerated_sigma_kwh=back_spread * vehicle.wheel_to_line,
        auxiliaries_kwh=auxiliaries,
        auxiliaries_sigma_kwh=auxiliaries * AUXILIARIES_SHARE,
    )


def _parts(way_kwh: Floats, pulled_n: Floats, resistance_n: Floats) -> tuple[float, float]:
    """Standard deviations [kWh] from mass and from resistance."""
    return float(way_kwh @ pulled_n) * MASS_SHARE, float(way_kwh @ resistance_n) * RESISTANCE_SHARE


def excess_of_positive_part(force_n: Floats, noise_n: float) -> Floats:
    """By how much normal noise enlarges the positive part of a force on average, in closed form; shape of `force_n`."""
    if noise_n <= 0.0:
        return np.zeros(len(force_n))
    found = np.zeros(len(force_n))
    near = np.flatnonzero(np.abs(force_n) < FAR * noise_n)
    z = np.abs(force_n[near]) / noise_n
    density = np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
    # Mills' ratio by Abramowitz and Stegun 26.2.17 (error below 7.5e-8): numpy has no error function.
    share = 1.0 / (1.0 + 0.2316419 * z)
    terms = (0.319381530, -0.356563782, 1.781477937, -1.821255978, 1.330274429)
    tail = density * sum(factor * share ** (power + 1) for power, factor in enumerate(terms))
    found[near] = noise_n * np.maximum(density - z * tail, 0.0)
    return found
