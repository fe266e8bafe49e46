from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.simulator.train_run import TrainRun, TrainRunError


def run(*stations_m: float) -> TrainRun:
    return TrainRun(stations_m, cruise_mps=20.0, acceleration_mps2=0.5, braking_mps2=1.0, dwell_s=30.0)


def test_a_leg_is_a_trapezium_of_speed() -> None:
    there = run(100.0, 1700.0)
    # Starting takes 40 s and 400 m, braking 20 s and 200 m, the 1000 m between take 50 s.
    assert there.at(29.0).axis_m == 100.0
    assert there.at(30.0 + 40.0).axis_m == pytest.approx(500.0)
    assert there.at(30.0 + 40.0 + 25.0).speed_mps == pytest.approx(20.0)
    assert there.at(30.0 + 110.0).axis_m == pytest.approx(1700.0)
    assert there.period_s == pytest.approx(2 * 140.0)


def test_it_comes_back_and_starts_again() -> None:
    there = run(0.0, 500.0, 1700.0)
    assert there.at(there.period_s * 3).axis_m == pytest.approx(0.0)
    speeds = [there.at(t).speed_mps for t in range(int(there.period_s))]
    assert max(speeds) == pytest.approx(20.0)
    assert min(speeds) == pytest.approx(-20.0)


def test_between_close_stations_it_brakes_before_it_cruises() -> None:
    near = run(0.0, 150.0)
    # Peak speed v with v^2 / (2 a) + v^2 / (2 b) = 150 m: 10 m/s.
    peak = max(near.at(30.0 + t / 10).speed_mps for t in range(300))
    assert peak == pytest.approx(10.0)
    assert near.at(30.0 + 30.0).axis_m == pytest.approx(150.0)


@given(st.floats(-1e6, 1e6))
def test_speed_is_how_fast_the_place_changes(time_s: float) -> None:
    shuttle, step = run(0.0, 500.0, 1700.0), 1e-3
    before, here, after = (shuttle.at(time_s + d) for d in (-step / 2, 0.0, step / 2))
    # Within the step a kink of 1.5 m/s^2 changes the speed by a millimetre per second; time near 1e6 s is
    # known to 1e-10 s, which moves the place by 2e-9 m, over the step 2e-6 m/s.
    assert (after.axis_m - before.axis_m) / step == pytest.approx(here.speed_mps, abs=2e-3)
    assert 0.0 - 1e-6 <= here.axis_m <= 1700.0 + 1e-6


@pytest.mark.parametrize("stations", [(0.0,), (10.0, 10.0), (10.0, 0.0)])
def test_stations_must_rise(stations: tuple[float, ...]) -> None:
    with pytest.raises(TrainRunError, match="rising"):
        run(*stations)


def test_rates_must_be_positive() -> None:
    with pytest.raises(TrainRunError, match="positive"):
        TrainRun((0.0, 1.0), cruise_mps=0.0, acceleration_mps2=1.0, braking_mps2=1.0, dwell_s=0.0)
