"""Broadcast ephemerides of a nominal constellation: slots in planes, repeating over the ground.

GPS: the 24 slots of the baseline constellation with its three expanded ones (GPS SPS Performance
Standard 2020, tables 3.2-1 and 3.2-2; 2001 edition, table 3-1, for the Greenwich angle at the
epoch), and a spare in the widest gap of four planes: 31 satellites, as many as are usual.
Galileo: Walker 24/3/1 at 56 degrees (Galileo OS SDD, 2.3).
Every satellite passes the same places each sidereal day (GPS) or each ten (Galileo), so a
constellation stays what it is for decades. Eccentricities, harmonics and clocks are drawn from
a generator in usual sizes.

Ephemerides of successive reference times belong to one orbit: at a change nothing jumps by more
than the twelve decimals of a navigation file hold, to which all values are rounded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schemas.gnss import Ephemeris, KeplerOrbit
from schemas.gnss_time import NS, WEEK_S, unix_ns_from_gps

MU = 3.986005e14
"""Gravitational constant of GPS [m^3/s^2] (IS-GPS-200, table 20-IV)."""
MU_GALILEO = 3.986004418e14
"""The same of Galileo (OS SIS ICD, 5.1.1)."""
EARTH_RATE_RADPS = 7.2921151467e-5
"""IS-GPS-200, table 20-IV."""
NODE_RATE_RADPS = -8.0e-9
"""Regression of the nodes by the Earth's oblateness, about -0.04 degrees a day."""
DELTA_N_RADPS = 4.6e-9
"""Usual mean motion difference of GPS [rad/s]."""
REFRESH_S = 7200
"""A new ephemeris every two hours, its reference time in the middle of its use."""
EPOCH_WEEK = 2400
"""Slots and clocks are as drawn at the start of this GPS week (2026-01-04)."""
GREENWICH_RAD = np.deg2rad(279.06)
"""Greenwich hour angle 18:36:14.4 of the reference epoch of the slots."""

_NODES_DEG = {"A": 272.847, "B": 332.847, "C": 32.847, "D": 92.847, "E": 152.847, "F": 212.847}
_LATITUDES_DEG = {
    "A": (268.126, 161.786, 11.676, 41.806, 214.956),
    "B": (94.916, 66.356, 173.336, 309.976, 204.376),
    "C": (111.876, 11.796, 339.666, 241.556, 176.716),
    "D": (135.226, 282.676, 257.976, 35.156, 167.356, 338.916),
    "E": (197.046, 302.596, 66.066, 333.686, 131.556),
    "F": (238.886, 0.456, 334.016, 105.206, 135.346),
}


@dataclass(frozen=True, slots=True)
class Orbiter:
    """One satellite as drawn, at the start of EPOCH_WEEK."""

    satellite: str
    semi_major_m: float
    mean_motion_radps: float
    delta_n_radps: float
    inclination_rad: float
    eccentricity: float
    perigee_rad: float
    node_rad: float
    """Longitude of the ascending node at the epoch, Earth-fixed."""
    anomaly_rad: float
    harmonics: tuple[float, ...]
    """cuc, cus, cic, cis [rad], crc, crs [m]."""
    clock_bias_s: float
    clock_drift: float
    group_delay_s: float


def nominal_constellation(systems: str, generator: np.random.Generator) -> tuple[Orbiter, ...]:
    """Satellites of the systems among 'G' and 'E', drawn in that order."""
    drawn: list[Orbiter] = []
    if "G" in systems:
        slots = [(_NODES_DEG[plane], u) for plane, row in _LATITUDES_DEG.items() for u in row]
        motion = 2 * (EARTH_RATE_RADPS - NODE_RATE_RADPS)
        drawn += [
            _draw(f"G{i:02d}", np.deg2rad([node, u, 55.0]), motion, MU, generator)
            for i, (node, u) in enumerate(slots, start=1)
        ]
    if "E" in systems:
        motion = 1.7 * (EARTH_RATE_RADPS - NODE_RATE_RADPS)
        walker = [(120.0 * plane, 45.0 * slot + 15.0 * plane) for plane in range(3) for slot in range(8)]
        drawn += [
            _draw(f"E{i:02d}", np.deg2rad([node, u, 56.0]), motion, MU_GALILEO, generator)
            for i, (node, u) in enumerate(walker, start=1)
        ]
    return tuple(drawn)


def _draw(
    name: str, slot_rad: NDArray[np.float64], motion: float, mu: float, generator: np.random.Generator
) -> Orbiter:
    node, latitude, inclination = slot_rad
    perigee = generator.uniform(-np.pi, np.pi)
    return Orbiter(
        satellite=name,
        semi_major_m=float((mu / (motion - DELTA_N_RADPS) ** 2) ** (1 / 3)),
        mean_motion_radps=motion,
        delta_n_radps=DELTA_N_RADPS,
        inclination_rad=float(inclination + generator.normal(0.0, 0.005)),
        eccentricity=float(generator.uniform(0.001, 0.012)),
        perigee_rad=float(perigee),
        node_rad=float(node - GREENWICH_RAD),
        anomaly_rad=float(latitude - perigee),
        harmonics=(
            *(float(v) for v in generator.normal(0.0, 3e-6, 2)),
            *(float(v) for v in generator.normal(0.0, 1e-7, 2)),
            float(generator.normal(200.0, 80.0)),
            float(generator.normal(0.0, 60.0)),
        ),
        clock_bias_s=float(generator.uniform(-3e-4, 3e-4)),
        clock_drift=float(generator.normal(0.0, 2e-12)),
        group_delay_s=float(generator.normal(-5e-9, 5e-9)),
    )


def reference_time(gps_ns: int) -> int:
    """Reference time in use at a GPS time, both [ns] since the GPS epoch: the nearest even two hours."""
    step = REFRESH_S * NS
    return (gps_ns + step // 2) // step * step


def ephemeris(orbiter: Orbiter, reference_ns: int) -> Ephemeris:
    """What `orbiter` broadcasts with a reference time [ns] since the GPS epoch."""
    week, rest_ns = divmod(reference_ns, WEEK_S * NS)
    toe_s = rest_ns // NS
    since_s = (week - EPOCH_WEEK) * WEEK_S + toe_s
    cuc, cus, cic, cis, crc, crs = orbiter.harmonics
    # The broadcast node is that of the week's start, and turns with the Earth from there (IS-GPS-200, table 20-IV).
    node = orbiter.node_rad + NODE_RATE_RADPS * since_s - EARTH_RATE_RADPS * (since_s - toe_s)
    return Ephemeris(
        t_ns=unix_ns_from_gps(week, toe_s - REFRESH_S / 2),
        satellite=orbiter.satellite,
        gps_week=int(week),
        toe_s=float(toe_s),
        toc_s=float(toe_s),
        clock_bias_s=_as_filed(orbiter.clock_bias_s + orbiter.clock_drift * since_s),
        clock_drift=_as_filed(orbiter.clock_drift),
        group_delay_s=_as_filed(orbiter.group_delay_s),
        issue=int(since_s // REFRESH_S % 256),
        healthy=True,
        accuracy_m=2.4 if orbiter.satellite[0] == "G" else 3.12,
        fit_interval_s=float(REFRESH_S),
        orbit=KeplerOrbit(
            sqrt_a=_as_filed(orbiter.semi_major_m**0.5),
            eccentricity=_as_filed(orbiter.eccentricity),
            m0_rad=_as_filed(_wrapped(orbiter.anomaly_rad + orbiter.mean_motion_radps * since_s)),
            delta_n_radps=_as_filed(orbiter.delta_n_radps),
            omega0_rad=_as_filed(_wrapped(node)),
            omega_dot_radps=NODE_RATE_RADPS,
            omega_rad=_as_filed(_wrapped(orbiter.perigee_rad)),
            i0_rad=_as_filed(orbiter.inclination_rad),
            i_dot_radps=0.0,
            cuc_rad=_as_filed(cuc),
            cus_rad=_as_filed(cus),
            crc_m=_as_filed(crc),
            crs_m=_as_filed(crs),
            cic_rad=_as_filed(cic),
            cis_rad=_as_filed(cis),
        ),
    )


def _wrapped(angle_rad: float) -> float:
    return float((angle_rad + np.pi) % (2 * np.pi) - np.pi)


def _as_filed(value: float) -> float:
    """The value as a navigation file with twelve decimals holds it."""
    return float(f"{value:.12e}")
