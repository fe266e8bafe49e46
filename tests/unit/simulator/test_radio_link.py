"""Propagation, shadows, frames, draws: against closed forms."""

from __future__ import annotations

from math import comb, log10

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.line import Surroundings
from services.simulator.radio_draws import complex_normals, normals, stream, uniforms
from services.simulator.radio_link import bit_error_rate, frame_code
from services.simulator.radio_propagation import (
    SITE_WEAKEST_DB,
    antenna_db,
    breakpoint_m,
    clutter_db,
    distance_loss_db,
    free_space_loss_db,
    noise_dbm,
)
from services.simulator.radio_settings import RadioSettings
from services.simulator.radio_shadowing import passing, shadow
from services.simulator.weather_along import WeatherAlong, WeatherSettings, stations


@pytest.mark.parametrize(("distance_m", "mhz"), [(1.0, 2400.0), (1000.0, 400.0), (2000.0, 2412.0), (10_000.0, 900.0)])
def test_free_space_loss_is_that_of_the_textbook(distance_m: float, mhz: float) -> None:
    # 32.45 + 20 log10(f / MHz) + 20 log10(d / km); its constant is rounded to 0.01 dB.
    expected_db = 32.45 + 20.0 * log10(mhz) + 20.0 * log10(distance_m / 1000.0)
    assert float(free_space_loss_db(distance_m, mhz * 1e6)) == pytest.approx(expected_db, abs=0.01)


def test_beyond_the_breakpoint_loss_falls_with_the_fourth_power() -> None:
    settings = RadioSettings()
    # 4 · 8 m · 4 m over 0.12491 m.
    assert breakpoint_m(settings) == pytest.approx(1024.7, abs=0.1)
    losses = distance_loss_db(np.array([100.0, 200.0, 1100.0, 2200.0]), settings)
    assert losses[1] - losses[0] == pytest.approx(20.0 * log10(2.0))
    assert losses[3] - losses[2] == pytest.approx(40.0 * log10(2.0))
    plain = RadioSettings(loss="free_space")
    assert distance_loss_db(np.array([2200.0]), plain)[0] == float(free_space_loss_db(2200.0, 2.4e9))


def test_antennas_look_along_the_track_and_the_train_s_forward() -> None:
    settings = RadioSettings()
    along_m = np.array([-1000.0, 0.0, 1000.0])
    distance_m = np.hypot(along_m, 6.0)
    ahead, abeam, behind = antenna_db(along_m, distance_m, settings, rises=True)
    assert ahead == pytest.approx(0.0, abs=0.01)
    # At right angles the panels are at their floor: 12 (90 / 70)² is 19.8 dB, and the train's antenna at its own.
    assert abeam == pytest.approx(-min(12.0 * (90.0 / 70.0) ** 2, SITE_WEAKEST_DB) - 8.0, abs=0.01)
    assert behind == pytest.approx(-8.0, abs=0.01)
    assert antenna_db(along_m, distance_m, settings, rises=False)[::-1] == pytest.approx([ahead, abeam, behind])
    assert not antenna_db(along_m, distance_m, RadioSettings(antennas="isotropic"), rises=True).any()


def test_what_lies_between_takes_by_its_length() -> None:
    settings = RadioSettings(tunnel_db_per_km=10.0, forest_db_per_km=4.0)
    around = (
        Surroundings(kind="tunnel", start_axis_m=1000.0, end_axis_m=1500.0),
        Surroundings(kind="forest", start_axis_m=2000.0, end_axis_m=3000.0),
        Surroundings(kind="canyon", start_axis_m=0.0, end_axis_m=9000.0),
    )
    # From a radio at 2500 m: half the wood; the rest of the wood; half the wood and the tunnel, all and half of it.
    losses = clutter_db(around, 2500.0, np.array([2500.0, 3500.0, 900.0, 1250.0, 1800.0]), settings)
    assert losses == pytest.approx([0.0, 2.0, 7.0, 4.5, 2.0])


def test_noise_is_thermal() -> None:
    # k · 290 K is -174.0 dBm in 1 Hz.
    assert noise_dbm(RadioSettings(bandwidth_hz=1.0, noise_figure_db=0.0)) == pytest.approx(-173.975, abs=0.001)


def test_frames_fail_as_binomial_errors_do() -> None:
    code = frame_code(100, 2)
    for sinr_db in (4.0, 6.0, 9.0):
        rate = bit_error_rate(sinr_db)
        chances = [comb(100, k) * rate**k * (1 - rate) ** (100 - k) for k in range(3)]
        # The table has steps of 0.1 dB, of which these are some.
        assert float(code.received_at(np.array(sinr_db))) == pytest.approx(sum(chances), rel=1e-9)
        mean = sum(k * chance for k, chance in enumerate(chances)) / sum(chances)
        assert float(code.corrected_at(np.array(sinr_db))) == pytest.approx(mean, rel=1e-9)


@given(st.integers(8, 4000), st.integers(0, 60))
def test_more_signal_never_loses_more(bits: int, correctable: int) -> None:
    code = frame_code(bits, correctable)
    assert (np.diff(code.received) >= -1e-12).all()
    assert code.received[-1] == pytest.approx(1.0)
    assert (code.corrected <= correctable + 1e-9).all()


def test_shadows_are_alike_by_distance_and_the_same_again() -> None:
    first = shadow(stream(1, "R01"), 200_000, 5.0, 75.0)
    assert np.array_equal(first, shadow(stream(1, "R01"), 200_000, 5.0, 75.0))
    # A thousand kilometres of shadows 75 m long: 7000 independent ones, so figures hold to about 2 %.
    assert first.mean() == pytest.approx(0.0, abs=0.05)
    assert first.std() == pytest.approx(1.0, abs=0.05)
    for lag in (5, 15, 30):
        expected = np.exp(-lag * 5.0 / 75.0)
        assert np.mean(first[lag:] * first[:-lag]) == pytest.approx(expected, abs=0.05)
    other = shadow(stream(1, "R02"), 200_000, 5.0, 75.0)
    assert np.mean(first * other) == pytest.approx(0.0, abs=0.05)


def test_what_passes_differ_by_is_alike_over_a_hundred_metres() -> None:
    places = np.arange(0.0, 1e6, 10.0)
    values = passing(stream(3), places)
    # Ten thousand independent knots.
    assert values.std() == pytest.approx(1.0, abs=0.03)
    assert np.mean(values[:-3] * values[3:]) > 0.7
    assert abs(np.mean(values[:-30] * values[30:])) < 0.04


@given(st.integers(0, 2**40), st.integers(1, 50), st.integers(0, 2**31))
def test_a_draw_depends_on_its_number_alone(first: int, count: int, seed: int) -> None:
    numbers = np.arange(first, first + count)
    whole = uniforms(stream(seed), numbers)
    assert ((whole >= 0.0) & (whole < 1.0)).all()
    assert np.array_equal(whole, np.concatenate([uniforms(stream(seed), numbers[k : k + 1]) for k in range(count)]))


def test_draws_are_even_and_normal() -> None:
    numbers = np.arange(100_000)
    # Standard errors: 0.001 of a mean of uniforms, 0.003 and 0.0045 of the rest.
    assert uniforms(stream(5), numbers).mean() == pytest.approx(0.5, abs=0.005)
    values = normals(stream(6), numbers)
    assert (values.mean(), values.var()) == (pytest.approx(0.0, abs=0.015), pytest.approx(1.0, abs=0.02))
    assert (values**4).mean() == pytest.approx(3.0, abs=0.15)
    assert np.mean(np.abs(complex_normals(stream(7), numbers)) ** 2) == pytest.approx(1.0, abs=0.02)


def test_weather_has_seasons_days_and_snow_only_in_the_cold() -> None:
    weather = WeatherAlong(WeatherSettings(spell_c=0.0))
    hours = np.asarray(1_767_225_600.0 + 3600.0 * np.arange(365 * 24), np.float64)  # 2026
    temperature = weather.temperature_c(hours)
    assert temperature.max() == pytest.approx(11.0 + 11.0 + 4.0, abs=0.1)
    assert temperature.min() == pytest.approx(11.0 - 11.0 - 4.0, abs=0.1)
    assert int(temperature.argmax()) // 24 in range(195, 215)
    snow, wet = weather.snow_mm_per_h(hours), weather.wet_mm_per_h(hours)
    assert snow.max() > 0.0
    assert not snow[temperature >= 1.0].any()
    # 1460 spells: 15 % of them to within three standard errors of 0.9 %.
    assert (wet > 0.0).mean() == pytest.approx(0.15, abs=0.03)
    assert stations(10_000.0) == [2500.0, 7500.0]
