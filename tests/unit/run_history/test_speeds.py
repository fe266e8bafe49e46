"""What speeds are believed, and how they are smoothed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.run_history.speed_credibility import credible_speeds
from services.run_history.track_smoothing import PLACE_WANDER_S, WANDER_S, moving_average, smoothed
from services.run_history.traction_energy import traction_energy
from tests.unit.run_history.made_runs import TRAIN, wandering

T = np.arange(0.0, 200.0, 1.0)
START = np.clip((T - 30.0) * 0.6, 0.0, 20.0)


def test_a_clean_run_is_believed_whole() -> None:
    credible = credible_speeds(T, START + 0.001 * np.abs(np.sin(T)), 40.0)
    assert np.isfinite(credible.speed_mps[T > 31.0]).all()
    assert (credible.held, credible.dropped, credible.frozen, credible.spikes) == (0, 0, 0, 0)


def test_held_zeros_spikes_drops_and_frozen_values_are_left_out_and_counted() -> None:
    speed = START + 0.001 * np.abs(np.sin(T))
    speed[T < 30.0] = 0.0
    speed[(T >= 30.0) & (T < 42.0)] = 0.0
    speed[100] = 82.0
    speed[120:124] = 0.0
    speed[150:170] = 19.9
    credible = credible_speeds(T, speed, 40.0)
    assert credible.held >= 9
    assert np.isnan(credible.speed_mps[35:42]).all()
    assert np.isfinite(credible.speed_mps[:29]).all()
    assert credible.spikes == 1
    assert credible.dropped == 4
    assert credible.frozen == 19
    assert np.isnan(credible.speed_mps[[100, 121, 160]]).all()


def test_a_speed_held_steady_is_believed_where_the_places_go_on_just_so() -> None:
    speed = np.full(len(T), 19.4)
    rng = np.random.default_rng(5)
    advancing = -19.43 * T + rng.normal(0.0, 2.0, len(T))
    assert credible_speeds(T, speed, 40.0, advancing).frozen == 0
    slowing = np.cumsum(np.clip(19.4 - 0.1 * T, 0.0, None))
    assert credible_speeds(T, speed, 40.0, slowing).frozen == len(T) - 1
    assert credible_speeds(T, speed, 40.0, np.full(len(T), np.nan)).frozen == len(T) - 1
    assert credible_speeds(T, speed, 40.0).frozen == len(T) - 1


def test_a_fall_to_zero_from_walking_pace_is_a_stop() -> None:
    speed = np.clip(20.0 - T * 0.6, 0.0, 20.0)
    speed[speed < 2.5] = 0.0
    assert credible_speeds(T, speed, 40.0).dropped == 0


@given(seed=st.integers(0, 10_000))
def test_speeds_left_are_those_that_came(seed: int) -> None:
    rng = np.random.default_rng(seed)
    speed = rng.uniform(-5.0, 60.0, len(T)) * (rng.random(len(T)) > 0.3)
    left = credible_speeds(T, speed, 40.0).speed_mps
    kept = np.isfinite(left)
    assert np.array_equal(left[kept], speed[kept])
    assert ((left[kept] >= 0.0) & (left[kept] <= 40.0)).all()


@given(speed_mps=st.floats(0.0, 30.0), rise_mps2=st.floats(-0.1, 0.5), start_m=st.floats(-1e4, 1e4))
def test_smoothing_leaves_a_steady_rise_alone(speed_mps: float, rise_mps2: float, start_m: float) -> None:
    speed = speed_mps + rise_mps2 * T
    way = start_m + speed_mps * T + 0.5 * rise_mps2 * T * T
    track = smoothed(T, way, speed)
    # The first state is a guess: an acceleration of 0 with 0.5 m/s² pulls the first speeds a little its way.
    assert track.speed_mps == pytest.approx(speed, abs=0.03)
    assert track.acceleration_mps2[20:-20] == pytest.approx(rise_mps2, abs=0.01)


def test_smoothing_bridges_what_is_missing_and_says_how_sure() -> None:
    way = 20.0 * T
    speed = np.full(len(T), 20.0)
    missing = (T > 70.0) & (T < 130.0)
    track = smoothed(T, np.where(missing, np.nan, way), np.where(missing, np.nan, speed))
    assert track.way_m == pytest.approx(way, abs=0.1)
    # Under way a speed is as sure as its wandering part and the places allow, 0.14 m/s; in a minute without, half so.
    assert track.speed_sigma_mps[100] > 1.8 * track.speed_sigma_mps[30]
    assert track.way_sigma_m[100] > 1.8 * track.way_sigma_m[30]


@settings(max_examples=20)
@given(seed=st.integers(0, 1000))
def test_places_contradict_a_speed_that_wanders(seed: int) -> None:
    # What phones do at their worst: 2 m/s too fast for half a minute of a steady run, while the places go on.
    wander = 2.0 * np.exp(-(((T - 100.0) / 12.0) ** 2))
    speed = 20.0 + wander + wandering(len(T), 0.1, WANDER_S, seed)
    track = smoothed(T, 20.0 * T + wandering(len(T), 2.0, PLACE_WANDER_S, seed + 5000), speed)
    middle = (T > 70.0) & (T < 130.0)
    # A smoother with white errors alone follows the speed to 1.9 m/s; this one believes some of it, and some of what
    # the places wander.
    assert np.abs(track.speed_mps - 20.0)[middle].max() < 1.3
    assert track.way_m[middle] == pytest.approx(20.0 * T[middle], abs=12.0)


def test_after_a_long_gap_nothing_of_before_is_left() -> None:
    rng = np.random.default_rng(4)
    speed = START + rng.normal(0.0, 0.1, len(T))
    way = np.cumsum(START) + rng.normal(0.0, 2.0, len(T))
    alone = smoothed(T, way, speed)
    later = smoothed(
        np.concatenate((T, T + 1e6)), np.concatenate((5e4 - way, way)), np.concatenate((-speed[::-1], speed))
    )
    assert np.array_equal(later.speed_mps[len(T) :], alone.speed_mps)
    assert np.isfinite(later.acceleration_sigma_mps2).all()


def test_the_moving_average_is_the_mean_of_its_window() -> None:
    speed = np.random.default_rng(1).uniform(0.0, 20.0, len(T))
    assert moving_average(T, speed, 7.0)[50] == pytest.approx(speed[47:54].mean())
    speed[48:52] = np.nan
    assert moving_average(T, speed, 7.0)[50] == pytest.approx(np.nanmean(speed[47:54]))
    assert np.isnan(moving_average(T, np.full(len(T), np.nan), 7.0)).all()


@given(climb=st.floats(0.0, 30.0), speed_mps=st.floats(1.0, 30.0))
def test_cruising_costs_resistance_and_climb(climb: float, speed_mps: float) -> None:
    n = len(T)
    force = TRAIN.track_force_n(climb, 0.0)
    still = np.zeros(n)
    energy = traction_energy(TRAIN, T, np.full(n, speed_mps), still, still, np.full(n, float(force)))
    expected_j = (float(TRAIN.resistance_n(speed_mps)) + float(force)) * speed_mps * (T[-1] - T[0])
    assert energy.wheel_kwh == pytest.approx(expected_j / 3.6e6)
    assert energy.traction_kwh == pytest.approx(energy.wheel_kwh / 0.85)
    assert energy.regenerated_kwh == 0.0


def test_braking_costs_nothing_and_curves_cost() -> None:
    n = len(T)
    still = np.zeros(n)
    braking = traction_energy(TRAIN, T, np.full(n, 10.0), still - 1.0, still, still)
    assert braking.traction_kwh == 0.0
    assert float(TRAIN.track_force_n(0.0, 1.0 / 400.0)) == pytest.approx(
        7845.0 / 400.0 * TRAIN.running_mass_kg / 1000.0
    )
