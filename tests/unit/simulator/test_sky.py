from __future__ import annotations

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.gnss_time import NS, WEEK_S
from services.gnss_correction.atmosphere import LIGHT_MPS
from services.gnss_correction.ephemeris_table import tabulate
from services.gnss_correction.orbit import satellite_states
from services.simulator.constellation import EARTH_RATE_RADPS
from services.simulator.local_plane import LocalPlane
from services.simulator.scenario import Sky
from services.simulator.sky import VisibleSky

START_NS = (2412 * WEEK_S + 190_800) * NS
PLANE = LocalPlane(35.44, 139.83, 50.0)
EMPTY = Sky(signal_in_space_sigma_m=0.0, ionosphere_scale=0.0, troposphere_scale=0.0)


def sky(settings: Sky) -> VisibleSky:
    return VisibleSky(settings, np.random.default_rng(11))


def test_pseudoranges_are_the_light_time_in_a_resting_frame() -> None:
    there = sky(EMPTY)
    antenna = PLANE.ecef(np.array([300.0, -200.0, 4.0]))
    arrivals = there.arrivals(START_NS, 0.0, antenna, np.zeros(3))
    table = tabulate(there.ephemerides(START_NS))
    t_s = START_NS / NS - table.gps_week * WEEK_S
    for i in range(len(there.satellites)):
        travel_s = 0.07
        for _ in range(5):
            sent = satellite_states(table, np.array([i]), np.array([t_s - travel_s]))
            # In the frame that rests and coincides with the Earth's at transmission, the antenna goes on turning.
            turn = EARTH_RATE_RADPS * travel_s
            turned = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
            distance = float(np.linalg.norm(turned @ antenna - sent.position_m[0]))
            travel_s = distance / LIGHT_MPS
        # Two rounds from a first guess off by 25 ms (behind the Earth) leave 6e-8 s of 0.9 km/s.
        expected = distance - LIGHT_MPS * sent.clock_bias_s[0]
        assert arrivals.code_m[i] == pytest.approx(expected, abs=6e-5)


@pytest.mark.parametrize("settings", [EMPTY, Sky()])
def test_the_rate_is_how_fast_the_pseudorange_grows(settings: Sky) -> None:
    there, step_s = sky(settings), 1.0
    place, velocity = np.array([0.0, 0.0, 4.0]), np.array([12.0, -9.0, 0.0])

    def at(offset_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        arrivals = there.arrivals(
            START_NS + round(offset_s * NS),
            0.0,
            PLANE.ecef(place + offset_s * velocity),
            PLANE.ecef_velocity(place + offset_s * velocity, velocity),
        )
        return arrivals.code_m, arrivals.rate_mps

    high = there.arrivals(START_NS, 0.0, PLANE.ecef(place), np.zeros(3)).elevation_rad > np.deg2rad(10.0)
    change = (at(step_s / 2)[0] - at(-step_s / 2)[0]) / step_s
    # A central difference over 1 s misses a 24th of the jerk (1e-4 m/s^3) and rounds at 1e-8 m. The air, left
    # out of the rate, gives 2.4 m cos(e) / sin(e)^2 times 1.4e-4 rad/s of elevation: 1.1 cm/s at 10 degrees.
    tolerance = 1e-5 if settings is EMPTY else 1.1e-2
    assert np.abs(change - at(0.0)[1])[high].max() < tolerance


def test_code_and_carrier_part_by_twice_the_ionosphere() -> None:
    broadcast = msgspec.structs.replace(EMPTY, ionosphere_scale=1.0)
    doubled = msgspec.structs.replace(EMPTY, ionosphere_scale=2.0)
    antenna = PLANE.ecef(np.array([0.0, 0.0, 4.0]))
    clear, once, twice = (
        sky(settings).arrivals(START_NS, 0.0, antenna, np.zeros(3)) for settings in (EMPTY, broadcast, doubled)
    )
    up = clear.elevation_rad > 0
    delay = once.code_m - clear.code_m
    # The delay also moves the moment of transmission, by 1e-7 s of 1 km/s.
    assert np.allclose(once.code_m - once.carrier_m, 2 * delay, atol=1e-3)
    assert np.allclose(twice.code_m - clear.code_m, 2 * delay, atol=1e-3)
    assert (delay[up] > 1.0).all()


def test_signal_in_space_errors_stay_with_their_satellite() -> None:
    antenna = PLANE.ecef(np.array([0.0, 0.0, 4.0]))

    def error(offset_s: int) -> NDArray[np.float64]:
        tag_ns = START_NS + offset_s * NS
        perfect, real = (
            sky(msgspec.structs.replace(EMPTY, signal_in_space_sigma_m=sigma)).arrivals(
                tag_ns, 0.0, antenna, np.zeros(3)
            )
            for sigma in (0.0, 1.0)
        )
        return np.asarray(real.code_m - perfect.code_m)

    assert np.allclose(error(0), error(7200), atol=1e-6)
    assert 0.5 < error(0).std() < 1.5
