"""Delays of the air against the models' closed values."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.gnss_correction.atmosphere import L1_HZ, LIGHT_MPS, klobuchar_delay_m, saastamoinen_delay_m

ALPHA = (1.2e-8, 0.0, 0.0, 0.0)
BETA = (100_000.0, 0.0, 0.0, 0.0)
ZENITH = math.pi / 2
ZENITH_SLANT = 1.0 + 16.0 * (0.53 - 0.5) ** 3
FROM_NORTH = 0.0
AFTERNOON_S = 50_400.0
"""14 h local time, when the model's ionosphere is thickest, at longitude 0."""


def delay(tow_s: float, *, elevation: float = ZENITH, carrier_hz: float = L1_HZ) -> float:
    return float(klobuchar_delay_m(ALPHA, BETA, 0.6, 0.0, elevation, FROM_NORTH, tow_s, carrier_hz))


def test_the_ionosphere_is_thickest_in_the_afternoon() -> None:
    assert delay(AFTERNOON_S) == pytest.approx(ZENITH_SLANT * (5e-9 + 1.2e-8) * LIGHT_MPS, rel=1e-12)
    assert delay(AFTERNOON_S + 86_400.0 * 3) == pytest.approx(delay(AFTERNOON_S), rel=1e-12)


def test_at_night_it_is_five_nanoseconds() -> None:
    assert delay(7_200.0) == pytest.approx(ZENITH_SLANT * 5e-9 * LIGHT_MPS, rel=1e-12)


def test_a_quarter_of_the_frequency_has_sixteen_times_the_delay() -> None:
    assert delay(AFTERNOON_S, carrier_hz=L1_HZ / 4) == pytest.approx(16 * delay(AFTERNOON_S), rel=1e-12)


def test_negative_amplitudes_and_short_periods_are_cut_off() -> None:
    cut = klobuchar_delay_m((-1.0, 0, 0, 0), (1.0, 0, 0, 0), 0.6, 0.0, ZENITH, 0.0, AFTERNOON_S, L1_HZ)
    assert cut == pytest.approx(ZENITH_SLANT * 5e-9 * LIGHT_MPS, rel=1e-12)


def test_below_the_horizon_there_is_no_delay() -> None:
    assert delay(AFTERNOON_S, elevation=-0.01) == 0.0
    assert saastamoinen_delay_m(0.6, 100.0, -0.01) == 0.0
    assert saastamoinen_delay_m(0.6, 100.0, 0.0) == 0.0


def test_the_zenith_at_sea_level_is_a_good_two_metres_and_a_third() -> None:
    # 2.30 to 2.31 m dry and 5 to 15 cm wet in the standard atmosphere with half-saturated air.
    assert 2.35 < saastamoinen_delay_m(math.radians(45.0), 0.0, ZENITH) < 2.46


def test_the_mapping_is_that_of_black_and_eisner() -> None:
    zenith, low = (saastamoinen_delay_m(0.6, 0.0, elevation) for elevation in (ZENITH, math.radians(5.0)))
    mapped = math.sqrt((0.002001 + 1.0) / (0.002001 + math.sin(math.radians(5.0)) ** 2))
    assert low / zenith == pytest.approx(mapped, rel=1e-12)


@pytest.mark.parametrize("h_m", [-1_000.0, -6.4e6, 10_000.0, 2e7, math.inf, -math.inf])
def test_absurd_heights_have_none(h_m: float) -> None:
    assert saastamoinen_delay_m(0.6, h_m, 1.0) == 0.0


@given(
    lat=st.floats(-1.57, 1.57),
    elevation=st.floats(-0.5, 1.57),
    azimuth=st.floats(0.0, 6.28),
    tow_s=st.floats(0.0, 604_800.0),
    h_m=st.floats(-2_000.0, 20_000.0),
)
def test_delays_are_never_negative_nor_beyond_reason(
    lat: float, elevation: float, azimuth: float, tow_s: float, h_m: float
) -> None:
    ionosphere = klobuchar_delay_m(ALPHA, BETA, lat, 1.0, elevation, azimuth, tow_s, L1_HZ)
    assert 0.0 <= ionosphere < 20.0
    assert 0.0 <= saastamoinen_delay_m(lat, h_m, elevation) < 80.0


def test_arrays_are_taken_as_they_come() -> None:
    elevation = np.array([-0.1, 0.2, 1.0])
    together = klobuchar_delay_m(ALPHA, BETA, 0.6, 0.1, elevation, 2.0, AFTERNOON_S, L1_HZ)
    one_by_one = [klobuchar_delay_m(ALPHA, BETA, 0.6, 0.1, float(e), 2.0, AFTERNOON_S, L1_HZ) for e in elevation]
    np.testing.assert_allclose(together, one_by_one, rtol=1e-14)
