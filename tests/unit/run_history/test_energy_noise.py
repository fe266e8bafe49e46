"""What noise of the speeds adds to the traction, and what is taken off for it."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.run_history.run_analysis import analyse_run
from services.run_history.speed_noise import acceleration_noise_mps2
from services.run_history.track_smoothing import PLACE_WANDER_M, PLACE_WANDER_S, WANDER_S, smoothed
from services.run_history.traction_energy import excess_of_positive_part, traction_energy
from services.run_history.vehicle import Vehicle
from tests.unit.run_history.made_runs import LINE, TRAIN, WAY, made_run, wandering

T = np.arange(0.0, 600.0, 1.0)
STILL = np.zeros(len(T))


@given(force=st.floats(-5.0, 5.0), noise=st.floats(0.1, 3.0))
def test_the_excess_is_that_of_a_normal_noise(force: float, noise: float) -> None:
    draws = force + noise * np.random.default_rng(1).standard_normal(200_000)
    expected = float(np.maximum(draws, 0.0).mean()) - max(force, 0.0)
    # The mean of 200,000 draws is known to noise / 450; three of them.
    assert excess_of_positive_part(np.array([force]), noise)[0] == pytest.approx(expected, abs=noise / 120.0)


def test_without_noise_nothing_is_taken_off() -> None:
    assert np.all(excess_of_positive_part(np.linspace(-1.0, 1.0, 5), 0.0) == 0.0)
    assert excess_of_positive_part(np.array([0.0]), 2.0)[0] == pytest.approx(2.0 / np.sqrt(2.0 * np.pi), rel=1e-6)


@settings(max_examples=15)
@given(white_mps=st.floats(0.03, 0.3), wander_mps=st.floats(0.1, 0.5), seed=st.integers(0, 1000))
def test_the_noise_left_in_the_acceleration_is_told_from_the_residuals(
    white_mps: float, wander_mps: float, seed: int
) -> None:
    white = np.random.default_rng(seed).normal(0.0, white_mps, len(T))
    speed = 20.0 + white + wandering(len(T), wander_mps, WANDER_S, seed + 1)
    place = 20.0 * T + wandering(len(T), PLACE_WANDER_M, PLACE_WANDER_S, seed + 2)
    track = smoothed(T, place, speed)
    told = acceleration_noise_mps2(T, speed, track.speed_mps, None)
    seen = float(track.acceleration_mps2[20:-20].std())
    # Some forty independent values of the acceleration, weights of Student's t beside the plain smoother: half as much.
    assert 0.5 < told / seen < 2.0


def test_where_places_are_better_than_assumed_too_much_is_told_rather_than_too_little() -> None:
    rng = np.random.default_rng(8)
    speed = 20.0 + rng.normal(0.0, 0.1, len(T))
    track = smoothed(T, 20.0 * T + rng.normal(0.0, 2.0, len(T)), speed)
    told = acceleration_noise_mps2(T, speed, track.speed_mps, None)
    # 0.011 for 0.005 m/s²: either is far below what a train accelerates with.
    assert float(track.acceleration_mps2[20:-20].std()) < told < 0.015


def test_a_window_leaves_the_noise_over_its_width() -> None:
    rng = np.random.default_rng(3)
    speed = 20.0 + rng.normal(0.0, 0.1, len(T))
    assert acceleration_noise_mps2(T, speed, np.full(len(T), 20.0), 7.0) == pytest.approx(0.1 / 7.0, rel=0.1)
    assert acceleration_noise_mps2(T, STILL, STILL, None) == 0.0


@settings(max_examples=20)
@given(noise=st.floats(0.005, 0.05), speed_mps=st.floats(5.0, 30.0))
def test_the_correction_brings_a_noisy_coasting_train_nearer_to_the_truth(noise: float, speed_mps: float) -> None:
    # Forces spread evenly about zero, as where a train goes over from driving to coasting and braking; each with the
    # whole normal distribution of the noise, in a hundred equal parts.
    parts = np.array([NormalDist().inv_cdf((k + 0.5) / 100.0) for k in range(100)])
    true = np.repeat(np.linspace(-6.0, 6.0, 61) * noise, len(parts))
    t, still = np.arange(float(len(true))), np.zeros(len(true))
    speed, level = still + speed_mps, still - float(TRAIN.resistance_n(speed_mps))
    plain = traction_energy(TRAIN, t, speed, true, still, level)
    noisy = traction_energy(TRAIN, t, speed, true + noise * np.tile(parts, 61), still, level, noise)
    excess = noisy.traction_kwh + noisy.noise_kwh - plain.traction_kwh
    assert excess > 0.0
    # Over all forces alike the correction is what it is to be; a hundred parts and the edges leave some per cent of it.
    assert noisy.noise_kwh == pytest.approx(excess, rel=0.05)
    assert noisy.noise_sigma_kwh == pytest.approx(0.5 * noisy.noise_kwh)


def test_the_correction_of_a_made_run_is_small_and_grows_with_its_noise() -> None:
    found = []
    for share in (0.0, 1.0, 3.0):
        leg = analyse_run(made_run(noise=share), [WAY], LINE.stations, TRAIN).legs[0]
        found.append(leg.energy)
    # The places' part is as it is assumed, whatever they were; the speeds' part grows beyond it.
    assert max(found[0].noise_kwh, found[1].noise_kwh) < found[2].noise_kwh
    assert 0.0 < found[2].noise_kwh < 0.02 * found[2].traction_kwh
    # Noise three times as large changes the smoothed run itself; the energy stays within one per cent.
    assert found[2].traction_kwh == pytest.approx(found[0].traction_kwh, rel=0.01)


def test_regeneration_and_auxiliaries_are_told_apart_with_their_uncertainty() -> None:
    train = Vehicle(name="both", mass_t=100.0, regeneration_efficiency=0.6, auxiliaries_kw=36.0)
    energy = traction_energy(train, T, STILL + 10.0, STILL - 1.0, STILL, STILL)
    braked_kwh = (train.inertial_mass_kg - float(train.resistance_n(10.0))) * 10.0 * 599.0 / 3.6e6
    assert energy.regenerated_kwh == pytest.approx(0.6 * braked_kwh)
    assert energy.auxiliaries_kwh == pytest.approx(36.0 * 599.0 / 3600.0)
    assert energy.traction_kwh == 0.0
    assert 0.2 < energy.regenerated_sigma_kwh / energy.regenerated_kwh < 0.3
    assert energy.auxiliaries_sigma_kwh == pytest.approx(0.2 * energy.auxiliaries_kwh)


def test_what_the_vehicle_file_leaves_out_is_assumed_by_its_drive() -> None:
    assert Vehicle(name="a", mass_t=1.0).wheel_to_line == 0.5
    assert Vehicle(name="a", mass_t=1.0, drive="resistor").wheel_to_line == 0.0
    assert Vehicle(name="a", mass_t=1.0, regeneration_efficiency=0.0).wheel_to_line == 0.0
    assert Vehicle(name="a", mass_t=1.0, cars=6).auxiliaries == 60.0
