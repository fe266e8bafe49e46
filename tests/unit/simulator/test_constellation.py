from __future__ import annotations

import numpy as np
import pytest

from schemas.gnss import KeplerOrbit
from schemas.gnss_time import NS, WEEK_S
from services.gnss_correction.ephemeris_table import tabulate
from services.gnss_correction.orbit import SatelliteStates, satellite_states
from services.simulator.constellation import (
    EARTH_RATE_RADPS,
    NODE_RATE_RADPS,
    REFRESH_S,
    ephemeris,
    nominal_constellation,
    reference_time,
)

START_NS = (2412 * WEEK_S + 190_800) * NS


def states(systems: str, reference_ns: int, gps_ns: int) -> SatelliteStates:
    drawn = nominal_constellation(systems, np.random.default_rng(3))
    table = tabulate([ephemeris(orbiter, reference_ns) for orbiter in drawn], 2412)
    t_s = (gps_ns - 2412 * WEEK_S * NS) / NS
    return satellite_states(table, np.arange(len(drawn)), np.full(len(drawn), t_s))


def test_gps_and_galileo_are_complete_and_named_in_order() -> None:
    names = [orbiter.satellite for orbiter in nominal_constellation("GE", np.random.default_rng(0))]
    assert names == [f"G{i:02d}" for i in range(1, 32)] + [f"E{i:02d}" for i in range(1, 25)]


@pytest.mark.parametrize(
    ("systems", "semi_major_m", "tolerance_m"), [("G", 26_559_710.0, 4e3), ("E", 29_599_800.0, 3e4)]
)
def test_orbits_have_the_size_of_the_standard(systems: str, semi_major_m: float, tolerance_m: float) -> None:
    # The repeating ground track fixes the size together with the chosen rates; the standards allow more.
    for orbiter in nominal_constellation(systems, np.random.default_rng(1)):
        assert orbiter.semi_major_m == pytest.approx(semi_major_m, abs=tolerance_m)


@pytest.mark.parametrize("systems", ["G", "E"])
def test_nothing_jumps_when_ephemerides_change(systems: str) -> None:
    reference_ns = reference_time(START_NS)
    change_ns = reference_ns + REFRESH_S * NS // 2
    before, after = (states(systems, r, change_ns) for r in (reference_ns, reference_ns + REFRESH_S * NS))
    # Twelve decimals: 1e-12 rad at 3e7 m, and 1e-12 of 5153 sqrt(m) twice.
    assert np.abs(after.position_m - before.position_m).max() < 5e-4
    assert np.abs(after.clock_bias_s - before.clock_bias_s).max() < 1e-15


def test_nothing_jumps_at_the_end_of_a_week() -> None:
    end_ns = 2413 * WEEK_S * NS
    before, after = (states("G", end_ns + d * REFRESH_S * NS, end_ns + 60 * NS) for d in (-1, 0))
    assert np.abs(after.position_m - before.position_m).max() < 5e-4


def test_satellites_come_back_over_the_same_place() -> None:
    day_ns = round(2 * np.pi / (EARTH_RATE_RADPS - NODE_RATE_RADPS) * NS)
    reference_ns = reference_time(START_NS)
    today = states("G", reference_ns, START_NS)
    tomorrow = states("G", reference_time(START_NS + day_ns), START_NS + day_ns)
    # The day is rounded to a nanosecond; twelve decimals as above.
    assert np.abs(tomorrow.position_m - today.position_m).max() < 1e-3


def test_satellites_spread_over_the_sky() -> None:
    directions = states("G", reference_time(START_NS), START_NS).position_m
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    # 31 evenly spread unit vectors sum to little; all in one half of the sky would give 15.
    assert np.linalg.norm(directions.sum(axis=0)) < 4.0


@pytest.mark.parametrize("offset_s", [0, 3599, 3600, 7199])
def test_the_reference_time_is_never_more_than_an_hour_away(offset_s: int) -> None:
    gps_ns = 2412 * WEEK_S * NS + offset_s * NS
    assert abs(reference_time(gps_ns) - gps_ns) <= REFRESH_S * NS // 2
    assert reference_time(gps_ns) % (REFRESH_S * NS) == 0


def test_values_are_those_that_a_navigation_file_holds() -> None:
    orbit = ephemeris(nominal_constellation("G", np.random.default_rng(5))[4], reference_time(START_NS)).orbit
    assert isinstance(orbit, KeplerOrbit)
    for name in orbit.__struct_fields__:
        value = getattr(orbit, name)
        assert float(f"{value:.12e}") == value
