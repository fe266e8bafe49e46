"""The satellites as an antenna would receive them with nothing in the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schemas.gnss import Ephemeris, Ionosphere
from schemas.gnss_time import NS, WEEK_S, unix_ns_from_gps
from services.gnss_correction.atmosphere import L1_HZ, LIGHT_MPS, klobuchar_delay_m, saastamoinen_delay_m
from services.gnss_correction.ephemeris_table import tabulate
from services.gnss_correction.orbit import SatelliteStates, satellite_states
from services.numerics.geodesy import elevation_azimuth, geodetic_from_ecef
from services.simulator import constellation
from services.simulator.scenario import Sky

Floats = NDArray[np.float64]
TRAVEL_S = 0.075
"""First guess of a signal's travel time: off by 10 ms, the final distance is off by 20 micrometres."""


@dataclass(frozen=True, slots=True)
class Arrivals:
    """Signals of every satellite at one place and instant; column i belongs to satellite i."""

    towards: Floats
    """Unit vectors (n, 3) from the antenna, Earth-fixed at reception."""
    elevation_rad: Floats
    azimuth_rad: Floats
    code_m: Floats
    """Pseudorange of a receiver with a perfect clock and no error of its own."""
    carrier_m: Floats
    """The same by the carrier, without ambiguity."""
    rate_mps: Floats
    """How fast both grow, the atmosphere's share (millimetres per second) left out."""


class VisibleSky:
    """A constellation and its atmosphere, drawn once, for every time."""

    def __init__(self, sky: Sky, generator: np.random.Generator) -> None:
        """Draw satellites, clocks and signal-in-space errors."""
        self._sky = sky
        self._orbiters = constellation.nominal_constellation(sky.systems, generator)
        self.satellites = tuple(orbiter.satellite for orbiter in self._orbiters)
        self._space_error_m = sky.signal_in_space_sigma_m * generator.standard_normal(len(self._orbiters))
        # A table stands in the order in which constellations are drawn: GPS, Galileo, by number.
        self._rows = np.arange(len(self._orbiters))
        self._reference_ns: int | None = None
        self._week = 0

    def ephemerides(self, gps_ns: int) -> tuple[Ephemeris, ...]:
        """What all satellites broadcast at a GPS time [ns], in the order of `satellites`."""
        reference_ns = constellation.reference_time(gps_ns)
        return tuple(constellation.ephemeris(orbiter, reference_ns) for orbiter in self._orbiters)

    def ionosphere(self, gps_ns: int) -> Ionosphere:
        """Broadcast Klobuchar coefficients."""
        week, rest_ns = divmod(gps_ns, WEEK_S * NS)
        t_ns = unix_ns_from_gps(week, rest_ns / NS)
        return Ionosphere(t_ns=t_ns, alpha=self._sky.ionosphere_alpha, beta=self._sky.ionosphere_beta)

    def arrivals(self, tag_ns: int, clock_bias_s: float, position_m: Floats, velocity_mps: Floats) -> Arrivals:
        """Signals at an Earth-fixed place (3,) when a clock off by `clock_bias_s` shows `tag_ns` [ns]."""
        reference_ns = constellation.reference_time(tag_ns)
        if reference_ns != self._reference_ns:
            ephemerides = self.ephemerides(tag_ns)
            self._reference_ns, self._week = reference_ns, ephemerides[0].gps_week
            self._table = tabulate(ephemerides)
        tow_s = (tag_ns - self._week * WEEK_S * NS) / NS
        return self._at(tow_s - clock_bias_s, position_m, velocity_mps)

    def _at(self, t_s: float, position_m: Floats, velocity_mps: Floats) -> Arrivals:
        states, angle, there, distance = self._distance(t_s, np.full(len(self._rows), TRAVEL_S), position_m)
        elevation, azimuth = elevation_azimuth(position_m, there)
        ionosphere, troposphere = self._atmosphere(t_s, position_m, elevation, azimuth)
        travel_s = (distance + ionosphere + troposphere) / LIGHT_MPS
        states, angle, there, distance = self._distance(t_s, travel_s, position_m)
        towards = (there - position_m) / distance[:, None]
        clock_m = LIGHT_MPS * states.clock_bias_s - self._space_error_m
        return Arrivals(
            towards=towards,
            elevation_rad=elevation,
            azimuth_rad=azimuth,
            code_m=distance + ionosphere + troposphere - clock_m,
            carrier_m=distance - ionosphere + troposphere - clock_m,
            rate_mps=_range_rate(states, angle, there, towards, velocity_mps) - LIGHT_MPS * states.clock_drift,
        )

    def _distance(
        self, t_s: float, travel_s: Floats, position_m: Floats
    ) -> tuple[SatelliteStates, Floats, Floats, Floats]:
        """States at transmission, the Earth's turn since [rad], places and distances at reception."""
        states = satellite_states(self._table, self._rows, t_s - travel_s)
        angle = constellation.EARTH_RATE_RADPS * travel_s
        there = _turned(states.position_m, angle)
        apart = there - position_m
        return states, angle, there, np.sqrt((apart * apart).sum(axis=1))

    def _atmosphere(self, t_s: float, position_m: Floats, elevation: Floats, azimuth: Floats) -> tuple[Floats, Floats]:
        lat, lon, height = geodetic_from_ecef(*position_m)
        ionosphere = klobuchar_delay_m(
            self._sky.ionosphere_alpha, self._sky.ionosphere_beta, lat, lon, elevation, azimuth, t_s % WEEK_S, L1_HZ
        )
        troposphere = saastamoinen_delay_m(lat, height, elevation)
        return self._sky.ionosphere_scale * ionosphere, self._sky.troposphere_scale * troposphere


def _turned(vectors: Floats, angle_rad: Floats) -> Floats:
    """Vectors (n, 3) in the Earth-fixed frame that has turned on by `angle_rad` (n,) since."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    x, y, z = vectors.T
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=1)


def _range_rate(
    states: SatelliteStates, angle_rad: Floats, there: Floats, towards: Floats, velocity_mps: Floats
) -> Floats:
    """Rate of the distance [m/s] for a receiver's second.

    The signal left earlier by the travel time, which changes too: with u towards the satellite,
    v its velocity in the turning and w in the resting frame, rate = u.(v - v_receiver) / (1 + u.w / c).
    """
    moving = _turned(states.velocity_mps, angle_rad)
    turning = constellation.EARTH_RATE_RADPS * np.stack([-there[:, 1], there[:, 0], np.zeros(len(there))], axis=1)
    closing = ((moving - velocity_mps) * towards).sum(axis=1)
    resting = ((moving + turning) * towards).sum(axis=1)
    return np.asarray(closing / (1 + resting / LIGHT_MPS))
