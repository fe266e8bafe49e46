from __future__ import annotations

import numpy as np
import pytest

from services.simulator.motion_settings import Adhesion, Driving, MotionSettings, Vehicle
from services.simulator.motion_simulator import MotionSamples, MotionSimulator
from services.simulator.motion_state import STEP_S, fresh_state, vehicle_constants
from services.simulator.track_table import TrackTable
from services.simulator.train_dynamics import GRAVITY, move
from tests.unit.simulator.motion_tracks import IDEAL, uniform_track

FREE = MotionSettings(vehicle=Vehicle(davis_a_mps2=0.0, davis_b_per_s=0.0, davis_c_per_m=0.0))


def run(track: TrackTable, seconds: float, settings: MotionSettings = IDEAL, seed: int = 1) -> MotionSamples:
    return MotionSimulator(track, settings, np.random.default_rng(seed)).advance(round(seconds / STEP_S))


def test_without_resistance_energy_is_conserved_over_hill_and_dale() -> None:
    state, constants = fresh_state(), vehicle_constants(FREE)
    state["speed_mps"] = 20.0
    height = 0.0
    for k in range(20_000):
        slope, before = 0.03 * np.sin(k / 3000.0), float(state["way_m"][0])
        move(state, 0.0, slope, 0.0, constants)
        height += slope * (float(state["way_m"][0]) - before)
    energy = float(state["speed_mps"][0]) ** 2 / 2 + GRAVITY * height
    # The slope is taken at the start of each step of way: exact for a constant one, here to rounding alone.
    assert energy == pytest.approx(200.0, rel=1e-9)


def test_coasting_slows_by_running_and_curve_resistance() -> None:
    settings = MotionSettings()
    state = fresh_state()
    state["speed_mps"] = 20.0
    move(state, 0.0, 0.0, 1 / 300.0, vehicle_constants(settings))
    v = settings.vehicle
    davis = v.davis_a_mps2 + v.davis_b_per_s * 20.0 + v.davis_c_per_m * 400.0
    # 600/R kg/t: 2 N/kN at 300 m.
    assert state["acceleration_mps2"][0] == pytest.approx(-(davis + GRAVITY * 2e-3))


def test_brakes_hold_on_a_slope_and_never_push() -> None:
    state, constants = fresh_state(), vehicle_constants(MotionSettings())
    for _ in range(100):
        assert not move(state, -0.5, -0.035, 0.0, constants)
    assert state["speed_mps"][0] == state["way_m"][0] == 0.0


def test_distance_is_the_integral_of_speed_and_speed_that_of_acceleration() -> None:
    samples = run(uniform_track(slope=0.01), 400.0)
    way = np.cumsum((samples.speed_mps[1:] + samples.speed_mps[:-1]) / 2 * STEP_S)
    # Trapezia are exact for constant acceleration within a step; only the step of coming to rest is not whole.
    assert np.allclose(samples.distance_m[1:] - samples.distance_m[0], way, atol=1e-3)
    moving = (samples.speed_mps[1:] > 0) & (samples.speed_mps[:-1] > 0)
    assert np.allclose(np.diff(samples.speed_mps)[moving], (samples.acceleration_mps2[1:] * STEP_S)[moving], atol=1e-12)


@pytest.mark.parametrize("slope", [-0.035, -0.02, 0.0, 0.02, 0.033])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_dry_train_stops_where_it_should_whatever_the_gradient(slope: float, seed: int) -> None:
    samples = run(uniform_track(slope=slope), 1200.0, seed=seed)
    halted = np.flatnonzero((samples.speed_mps[1:] == 0) & (samples.speed_mps[:-1] > 0) & (samples.trip[1:] == 0))
    stands = [float(w) for w in samples.way_m[halted]]
    for stop in (2000.0, 4000.0, 5800.0):
        # Doors open from 2.5 m before; a driver who decides every 0.4 s overruns by some metres on steep slopes,
        # on platforms that are some 20 m longer than their trains.
        assert min(abs(stop - stand) for stand in stands) < (2.6 if slope == 0.0 else 7.0)
    assert len(stands) <= 6


def test_the_driver_keeps_to_the_limits() -> None:
    limit = np.full(6001, 25.0)
    limit[1200:1500], limit[3000:3200] = 12.0, 8.0
    flat = np.zeros(6001)
    track = TrackTable(flat, flat, flat, limit, np.array([4000.0, 5800.0]))
    samples = run(track, 600.0)
    there = samples.trip == 0
    allowed = np.interp(samples.way_m[there], np.arange(6001), limit)
    # A driver who coasts at the limit is above it for moments: by a tenth at most.
    assert (samples.speed_mps[there] - 1.1 * allowed).max() < 0.0
    assert samples.speed_mps.max() > 15.0


def test_effort_changes_no_faster_than_jerk_allows() -> None:
    samples = run(uniform_track(), 300.0)
    assert np.abs(np.diff(samples.effort_mps2)).max() <= 0.7 * STEP_S + 1e-12


def test_at_the_last_stop_the_other_end_leads() -> None:
    settings = MotionSettings(imu=IDEAL.imu, driving=Driving(dwell_s=(5.0, 5.0)))
    samples = run(uniform_track(length_m=3000, stops_m=(600.0, 2800.0)), 500.0, settings)
    turned = int(np.flatnonzero(np.diff(samples.trip))[0])
    # The rear end, 60 m back, is the new front end; distance goes on.
    assert samples.way_m[turned + 1] == pytest.approx(3000.0 - samples.way_m[turned] + 60.0, abs=0.01)
    assert np.all(np.diff(samples.distance_m) >= 0)
    assert np.abs(np.diff(samples.distance_m)).max() < 25.0 * STEP_S


def test_samples_do_not_depend_on_how_they_are_asked_for() -> None:
    slippery = MotionSettings(adhesion=Adhesion(random_gap_s=30.0, shortest_gap_s=5.0), driving=Driving(dwell_s=(3, 3)))
    track = uniform_track(length_m=3000, stops_m=(1000.0, 2800.0))
    whole = run(track, 400.0, slippery)
    piecewise = MotionSimulator(track, slippery, np.random.default_rng(1))
    parts = [piecewise.advance(count) for count in (1, 9, 990, *[100] * 390)]
    for name in ("imu", "distance_m", "wheel_way_m", "slip", "trip"):
        together = np.concatenate([getattr(part, name) for part in parts])
        assert np.array_equal(together, getattr(whole, name)[: len(together)])
    assert whole.trip[-1] > 0
    assert np.any(whole.slip)


def test_a_track_without_a_stop_ahead_is_refused() -> None:
    with pytest.raises(ValueError, match="no stop ahead of 5900"):
        MotionSimulator(uniform_track(), IDEAL, np.random.default_rng(1), start_m=5900.0)
