"""A made-up constellation and what a receiver under it measures, without noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas.gnss import Ephemeris, Epoch, KeplerOrbit, StateVectorOrbit
from schemas.gnss_time import unix_ns_from_gps
from services.gnss_correction.atmosphere import L1_HZ, LIGHT_MPS, klobuchar_delay_m, saastamoinen_delay_m
from services.gnss_correction.ephemeris_table import select, tabulate
from services.gnss_correction.orbit import BEIDOU_B1I_HZ, SatelliteStates, satellite_states
from services.gnss_receiver.observations import satellite_code
from services.numerics.geodesy import ecef_from_geodetic, elevation_azimuth

WEEK = 2_300
START_S = 216_000.0
PLACE_DEG = (35.6, 139.7, 60.0)
PLACE_M = np.array(ecef_from_geodetic(math.radians(PLACE_DEG[0]), math.radians(PLACE_DEG[1]), PLACE_DEG[2]))
NO_IONOSPHERE = (0.0, 0.0, 0.0, 0.0)
EARTH_RATE_RADPS = 7.2921151467e-5
SIGNALS = {"G": "1C", "E": "1C", "C": "2I", "J": "1C"}


def kepler(**changes: float) -> KeplerOrbit:
    """A GPS-like orbit with every harmonic zero."""
    plain = dict.fromkeys(KeplerOrbit.__struct_fields__, 0.0)
    return KeplerOrbit(**(plain | {"sqrt_a": 5_153.7, "eccentricity": 0.008, "i0_rad": 0.96} | changes))


def ephemeris(satellite: str, orbit: KeplerOrbit | StateVectorOrbit | None = None, **changes: Any) -> Ephemeris:  # noqa: ANN401 - any field
    """An ephemeris of the made-up week with a clock that is not zero."""
    usual: dict[str, Any] = {
        "t_ns": unix_ns_from_gps(WEEK, START_S - 7_200.0),
        "gps_week": WEEK,
        "toe_s": START_S,
        "toc_s": START_S,
        "clock_bias_s": 1e-5 * (int(satellite[1:]) - 15),
        "clock_drift": 1e-11,
        "group_delay_s": -5e-9,
        "issue": 7,
        "healthy": True,
        "fit_interval_s": 7_200.0,
        "orbit": orbit or kepler(),
    }
    return Ephemeris(satellite=satellite, **(usual | changes))


def constellation(system: str = "G", count: int = 30) -> list[Ephemeris]:
    """`count` satellites in six planes."""
    return [
        ephemeris(
            f"{system}{number + 1:02d}",
            kepler(
                omega0_rad=2 * math.pi * (number % 6) / 6 + (0.3 if system == "E" else 0.0),
                m0_rad=2 * math.pi * (number // 6) / (count / 6) + 0.35 * (number % 6),
                omega_rad=0.7,
                omega_dot_radps=-8e-9,
            ),
        )
        for number in range(count)
    ]


def _sent(
    ephemerides: Sequence[Ephemeris], place_m: NDArray[np.float64], t_s: float
) -> tuple[SatelliteStates, NDArray[np.float64]]:
    """Satellites when the signals left that arrive at true time `t_s`, turned into the frame of reception; ranges."""
    table = tabulate(ephemerides, WEEK)
    codes = np.array([satellite_code(one.satellite) for one in ephemerides])
    row = select(table, codes, np.full(len(codes), t_s))
    travel_s = np.full(len(codes), 0.07)
    for _ in range(4):
        states = satellite_states(table, row, t_s - travel_s)
        angle = EARTH_RATE_RADPS * travel_s
        x, y, z = states.position_m.T
        turned = np.stack([np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x, z], axis=-1)
        range_m = np.linalg.norm(turned - place_m, axis=1)
        travel_s = range_m / LIGHT_MPS
    return states._replace(position_m=turned), range_m


def measured(
    ephemerides: Sequence[Ephemeris],
    t_s: float,
    *,
    place_m: NDArray[np.float64] = PLACE_M,
    velocity_mps: NDArray[np.float64] | None = None,
    clocks_m: Mapping[str, float] | None = None,
    lowest_rad: float = 0.1,
    cn0_dbhz: float = 45.0,
) -> Epoch:
    """Epoch of a receiver at `place_m`, exact to a millimetre: geometry, clocks, broadcast atmosphere, Doppler.

    `t_s` is true time in the made-up week; `clocks_m` the receiver's clock against each system.
    """
    clocks = clocks_m or {}
    states, range_m = _sent(ephemerides, place_m, t_s)
    elevation, azimuth = elevation_azimuth(place_m, states.position_m)
    lat, lon, h = (math.radians(PLACE_DEG[0]), math.radians(PLACE_DEG[1]), PLACE_DEG[2])
    carrier_hz = np.array([BEIDOU_B1I_HZ if one.satellite[0] == "C" else L1_HZ for one in ephemerides])
    delay_m = klobuchar_delay_m(NO_IONOSPHERE, NO_IONOSPHERE, lat, lon, elevation, azimuth, t_s, carrier_hz)
    delay_m = delay_m + saastamoinen_delay_m(lat, h, elevation)
    clock_m = np.array([clocks.get(one.satellite[0], 0.0) for one in ephemerides])
    pseudorange_m = range_m + clock_m - LIGHT_MPS * states.clock_bias_s + delay_m
    ahead_m = _sent(ephemerides, place_m + _moved(velocity_mps, 0.5), t_s + 0.5)
    behind_m = _sent(ephemerides, place_m - _moved(velocity_mps, 0.5), t_s - 0.5)
    rate_mps = ahead_m[1] - behind_m[1] - LIGHT_MPS * (ahead_m[0].clock_bias_s - behind_m[0].clock_bias_s)
    seen = np.flatnonzero(elevation > lowest_rad)
    names = tuple(ephemerides[i].satellite for i in seen.tolist())
    # The receiver stamps the epoch by its own clock; the first system's is taken for it.
    stamp_s = t_s + (clock_m[seen[0]] / LIGHT_MPS if seen.size else 0.0)
    return Epoch(
        t_ns=unix_ns_from_gps(WEEK, stamp_s),
        gps_week=WEEK,
        tow_s=stamp_s,
        satellites=names,
        signals=tuple(SIGNALS[name[0]] for name in names),
        pseudorange_m=pseudorange_m[seen],
        carrier_phase_cycles=np.full(seen.size, np.nan),
        doppler_hz=-rate_mps[seen] * carrier_hz[seen] / LIGHT_MPS,
        cn0_dbhz=np.full(seen.size, cn0_dbhz),
        lock_lost=np.zeros(seen.size, np.uint8),
    )


def _moved(velocity_mps: NDArray[np.float64] | None, seconds: float) -> NDArray[np.float64]:
    return np.zeros(3) if velocity_mps is None else velocity_mps * seconds
