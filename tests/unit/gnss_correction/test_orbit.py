"""Orbits and clocks against closed forms and against themselves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.gnss import Ephemeris, StateVectorOrbit
from services.gnss_correction.atmosphere import LIGHT_MPS
from services.gnss_correction.ephemeris_table import tabulate
from services.gnss_correction.orbit import SatelliteStates, satellite_states
from tests.unit.gnss_correction.made_up_sky import START_S, WEEK, constellation, ephemeris, kepler

MU = 3.986005e14
EARTH_RATE_RADPS = 7.2921151467e-5


def states_of(one: Ephemeris, *t_s: float) -> SatelliteStates:
    return satellite_states(tabulate([one], WEEK), np.zeros(len(t_s), np.int64), np.array(t_s))


def glonass(ahead_s: float = 0.0) -> Ephemeris:
    orbit = StateVectorOrbit(
        position_m=(17_436_554.7, 15_669_386.7, -9_966_914.1),
        velocity_mps=(-1_110.5, -817.5, -3_222.8),
        acceleration_mps2=(0.0, 0.0, 0.0),
        frequency_channel=-2,
    )
    return ephemeris("R09", orbit, toe_s=START_S + ahead_s, group_delay_s=0.0)


def test_a_circular_equatorial_orbit_is_a_circle() -> None:
    one = ephemeris("G01", kepler(eccentricity=0.0, i0_rad=0.0))
    ahead_s = 1_000.0
    motion = math.sqrt(MU) / 5_153.7**3
    angle = (motion - EARTH_RATE_RADPS) * ahead_s - EARTH_RATE_RADPS * START_S
    expected = 5_153.7**2 * np.array([math.cos(angle), math.sin(angle), 0.0])
    # Rounding of the angle over some hundred thousand seconds.
    np.testing.assert_allclose(states_of(one, START_S + ahead_s).position_m[0], expected, atol=1e-5)


@pytest.mark.parametrize("satellite", ["G01", "E01", "C11", "C03", "C59", "J02", "R09"])
@given(
    eccentricity=st.floats(0.0, 0.05),
    m0_rad=st.floats(-3.0, 3.0),
    harmonic=st.floats(-1e-5, 1e-5),
    ahead_s=st.floats(-3_000.0, 3_000.0),
)
@settings(max_examples=15)
def test_velocity_and_drift_are_the_rates_of_position_and_clock(
    satellite: str, eccentricity: float, m0_rad: float, harmonic: float, ahead_s: float
) -> None:
    orbit = kepler(
        eccentricity=eccentricity,
        m0_rad=m0_rad,
        omega_rad=0.4,
        omega_dot_radps=-8e-9,
        i_dot_radps=2e-10,
        delta_n_radps=4e-9,
        cuc_rad=harmonic,
        cus_rad=-harmonic,
        crc_m=3e7 * harmonic,
        crs_m=-2e7 * harmonic,
        cic_rad=harmonic / 3,
        cis_rad=harmonic / 2,
    )
    one = glonass() if satellite[0] == "R" else ephemeris(satellite, orbit, clock_drift_rate_per_s=1e-18)
    before, now, after = (START_S + ahead_s + step for step in (-0.5, 0.0, 0.5))
    states = states_of(one, before, now, after)
    # Third derivatives of such orbits are some 1e-5 m/s³, so that a central difference over 1 s errs by micrometres;
    # the rest is rounding of positions of 3e7 m, and with GLONASS a change of the Runge-Kutta step in between.
    np.testing.assert_allclose(states.position_m[2] - states.position_m[0], states.velocity_mps[1], atol=2e-4)
    assert states.clock_bias_s[2] - states.clock_bias_s[0] == pytest.approx(states.clock_drift[1], abs=1e-15)


@given(eccentricity=st.floats(0.0, 0.1), m0_rad=st.floats(-3.0, 3.0))
@settings(max_examples=25)
def test_the_relativistic_clock_is_twice_position_times_velocity(eccentricity: float, m0_rad: float) -> None:
    one = ephemeris(
        "G01",
        kepler(eccentricity=eccentricity, m0_rad=m0_rad),
        clock_bias_s=0.0,
        clock_drift=0.0,
        group_delay_s=0.0,
    )
    states = states_of(one, START_S + 600.0)
    # IS-GPS-200, 20.3.3.3.3.1; the Earth's turn adds nothing to r·v.
    expected = -2.0 * states.position_m[0] @ states.velocity_mps[0] / LIGHT_MPS**2
    assert states.clock_bias_s[0] == pytest.approx(expected, abs=1e-15)


def test_the_clock_has_its_polynomial_and_the_group_delay_is_taken_off() -> None:
    one = ephemeris(
        "E05",
        kepler(eccentricity=0.0),
        toc_s=START_S - 100.0,
        clock_bias_s=3e-4,
        clock_drift=2e-11,
        clock_drift_rate_per_s=1e-15,
        group_delay_s=4e-9,
    )
    states = states_of(one, START_S)
    assert states.clock_bias_s[0] == pytest.approx(3e-4 + 2e-9 + 1e-11 - 4e-9, abs=1e-18)
    assert states.clock_drift[0] == pytest.approx(2e-11 + 2e-13, abs=1e-22)


def test_a_geostationary_satellite_stands_still() -> None:
    rate = 7.2921150e-5
    sqrt_a = (3.986004418e14 / rate**2) ** (1 / 6)
    # Elements are given in a frame turned by -5° about the x axis: an orbit tilted by 5° about -x is the equator.
    orbit = kepler(
        sqrt_a=sqrt_a,
        eccentricity=0.0,
        i0_rad=math.radians(5.0),
        omega0_rad=math.pi + rate * (START_S - 14.0),
        omega_rad=math.pi,
    )
    states = states_of(ephemeris("C03", orbit), START_S - 3_000.0, START_S, START_S + 3_000.0)
    # Rounding alone.
    np.testing.assert_allclose(states.position_m, np.tile([sqrt_a**2, 0.0, 0.0], (3, 1)), atol=1e-4)
    np.testing.assert_allclose(states.velocity_mps, 0.0, atol=1e-8)


def test_beidou_counts_its_node_from_its_own_week() -> None:
    orbit = kepler(eccentricity=0.0, i0_rad=0.0)
    beidou = states_of(ephemeris("C20", orbit), START_S).position_m[0]
    galileo = states_of(ephemeris("E20", orbit), START_S).position_m[0]
    turned = math.atan2(beidou[1], beidou[0]) - math.atan2(galileo[1], galileo[0])
    # 14 s of the Earth's turn, and the two systems' slightly different rates over the week so far.
    expected = 7.2921150e-5 * 14.0 + (7.2921151467e-5 - 7.2921150e-5) * START_S
    assert turned == pytest.approx(expected, abs=1e-9)


def test_glonass_comes_back_along_its_way() -> None:
    there = states_of(glonass(), START_S + 900.0)
    orbit = StateVectorOrbit(
        position_m=tuple(there.position_m[0].tolist()),
        velocity_mps=tuple(there.velocity_mps[0].tolist()),
        acceleration_mps2=(0.0, 0.0, 0.0),
        frequency_channel=0,
    )
    back = states_of(ephemeris("R09", orbit, toe_s=START_S + 900.0), START_S)
    # Error of fifteen Runge-Kutta steps of 60 s, there and back.
    np.testing.assert_allclose(back.position_m[0], (17_436_554.7, 15_669_386.7, -9_966_914.1), atol=1e-3)


def test_glonass_keeps_its_jacobi_integral() -> None:
    states = states_of(glonass(), START_S, START_S + 900.0)
    a_m, j2, mu, rate = 6_378_136.0, 1.0826257e-3, 3.986004418e14, 7.292115e-5

    def integral(position: np.ndarray, velocity: np.ndarray) -> float:
        r, z = np.linalg.norm(position), position[2]
        potential = mu / r * (1.0 - j2 * (a_m / r) ** 2 * (1.5 * (z / r) ** 2 - 0.5))
        return float(velocity @ velocity / 2 - potential - rate**2 * (position[0] ** 2 + position[1] ** 2) / 2)

    first, last = (integral(p, v) for p, v in zip(states.position_m, states.velocity_mps, strict=True))
    # One part in 1e10 of 1.6e7 m²/s² is the rounding and the steps' error.
    assert last == pytest.approx(first, rel=1e-10)


def test_a_state_vector_is_not_integrated_for_days() -> None:
    states = states_of(glonass(), START_S + 90_000.0)
    assert np.isnan(states.position_m).all()


def test_a_pair_without_an_ephemeris_has_no_state() -> None:
    states = satellite_states(tabulate(constellation()), np.array([-1, 0]), np.full(2, START_S))
    assert np.isnan(states.position_m[0]).all()
    assert np.isnan(states.clock_bias_s[0])
    assert np.isfinite(states.position_m[1]).all()
