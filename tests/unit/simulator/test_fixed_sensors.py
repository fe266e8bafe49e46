"""Sensors fixed to the vehicle, which runs the other way after its last stop."""

from __future__ import annotations

import numpy as np
import pytest

from services.simulator.motion_settings import Vehicle
from services.simulator.motion_simulator import MotionSamples, MotionSimulator
from tests.unit.simulator.motion_tracks import IDEAL, uniform_track

TURNED = np.array([-1.0, -1.0, 1.0, -1.0, -1.0, 1.0])
"""x and y of a sensor that looks the other way."""


def there_and_back(*, fixed_sensors: bool) -> MotionSamples:
    """A left-hand curve uphill, from 4.8 km to the last stop at 5.8 km and back."""
    track = uniform_track(curvature_per_m=1 / 400.0, slope=0.01)
    simulator = MotionSimulator(track, IDEAL, np.random.default_rng(1), start_m=4800.0, fixed_sensors=fixed_sensors)
    return simulator.advance(24_000)


def test_the_same_train_is_felt_the_other_way_round() -> None:
    fixed, own = there_and_back(fixed_sensors=True), there_and_back(fixed_sensors=False)
    back = own.trip == 1
    assert 0 < np.sum(back) < len(back)
    assert np.all(own.forward == 1.0)
    assert fixed.forward == pytest.approx(np.where(back, -1.0, 1.0))
    assert fixed.imu[~back] == pytest.approx(own.imu[~back])
    # Everything of this track is the same wherever along the train the sensor sits.
    assert fixed.imu[back] == pytest.approx(own.imu[back] * TURNED, abs=1e-3)


def test_the_counter_runs_backwards_and_distance_falls() -> None:
    samples = there_and_back(fixed_sensors=True)
    back = samples.trip == 1
    assert np.all(np.diff(samples.wheel_way_m[back]) <= 0.0)
    assert np.all(np.diff(samples.distance_m[back]) <= 0.0)
    assert np.all(np.diff(samples.distance_m[~back]) >= 0.0)
    # No jump where the cabs change: 0.3 m is what 20 m/s and creep make in a step of 10 ms.
    assert np.max(np.abs(np.diff(samples.wheel_way_m))) < 0.3
    assert np.max(np.abs(np.diff(samples.distance_m))) < 0.3
    # There by the whole way to the stop; the front end that leads back begins a train's length nearer to the start.
    turned_m = samples.distance_m[~back][-1]
    assert turned_m == pytest.approx(1000.0, abs=5.0)
    gone_m = samples.way_m[back][-1] - (6000.0 - 5800.0 + Vehicle().length_m)
    assert samples.distance_m[-1] == pytest.approx(turned_m - gone_m, abs=5.0)
