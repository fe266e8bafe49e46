"""Departures and arrivals from slopes: closed form, properties, what receivers do at stops."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.run_history.leg_ends import HALT, START, V_RAMP_MPS, V_STOP_MPS, onset_of
from services.run_history.legs import assumed_ends, ends_by_slope, halt_of, legs_of, start_of, stops_of
from tests.unit.run_history.made_runs import LINE, Floats


def ramp_speed(t_s: Floats, slope: float, begin_s: float) -> Floats:
    return np.clip((t_s - begin_s) * slope, 0.0, 20.0)


@given(slope=st.floats(0.3, 1.3), begin_s=st.floats(20.0, 40.0))
def test_a_straight_ramp_gives_the_line_of_the_formula(slope: float, begin_s: float) -> None:
    t = np.arange(0.0, 120.0, 1.0)
    onset = onset_of(t, ramp_speed(t, slope, begin_s), START)
    assert onset is not None
    expected = begin_s + V_RAMP_MPS / slope * (1.0 - START.share) - START.fixed_s
    assert onset.still_s == pytest.approx(expected, abs=1e-6)
    assert onset.slope_mps2 == pytest.approx(slope, rel=1e-6)
    assert onset.stop_speed_s == pytest.approx(begin_s + V_STOP_MPS / slope, abs=1e-6)


@given(slope=st.floats(0.3, 1.3), shift_s=st.floats(-1e4, 1e4))
def test_ends_move_with_the_clock(slope: float, shift_s: float) -> None:
    t = np.arange(0.0, 120.0, 1.0)
    speed = ramp_speed(t, slope, 30.0)
    here, there = onset_of(t, speed, HALT), onset_of(t + shift_s, speed, HALT)
    assert here is not None
    assert there is not None
    assert there.still_s - here.still_s == pytest.approx(shift_s, abs=1e-6)


def test_zeros_held_after_a_departure_do_not_delay_it() -> None:
    t = np.arange(0.0, 120.0, 1.0)
    speed = ramp_speed(t, 0.6, 30.0)
    held = np.where((t > 30.0) & (t < 40.0), np.nan, speed)
    plain, bridged = onset_of(t, speed, START), onset_of(t, held, START)
    assert plain is not None
    assert bridged is not None
    assert bridged.still_s == pytest.approx(plain.still_s, abs=1e-6)


def test_a_fall_that_no_brake_can_do_ends_the_fit() -> None:
    t = np.arange(0.0, 120.0, 1.0)
    speed = ramp_speed(t, 0.9, 30.0)
    fallen = np.where(t >= 37.0, speed * 0.4, speed)
    onset = onset_of(t, fallen, START)
    assert onset is not None
    assert onset.slope_mps2 == pytest.approx(0.9, rel=1e-6)


def test_without_three_speeds_there_is_no_slope_and_ramps_are_assumed() -> None:
    t = np.arange(0.0, 400.0, 1.0)
    speed = np.minimum(ramp_speed(t, 0.6, 60.0), ramp_speed(400.0 - t, 0.6, 60.0))
    way = 1000.0 + 3000.0 * np.clip((t - 60.0) / 280.0, 0.0, 1.0)
    (leg,) = legs_of(stops_of(t, way, speed, LINE.stations))
    known = np.where((t > 60.0) & (t < 140.0), np.nan, speed)
    assert start_of(leg, t, known, np.full(400, np.nan)) is None
    assumed = assumed_ends(leg, t, speed, 0.48, 0.60)
    ends = ends_by_slope(assumed, None, halt_of(leg, t, known, np.full(400, np.nan)))
    assert ends.departure_s == assumed.departure_s
    assert ends.arrival_s == pytest.approx(340.0 - V_RAMP_MPS / 0.6 * (1.0 - HALT.share) + HALT.fixed_s, abs=1e-6)


def test_an_arrival_is_a_start_backwards() -> None:
    t = np.arange(0.0, 400.0, 1.0)
    speed = np.minimum(ramp_speed(t, 0.6, 60.0), ramp_speed(400.0 - t, 0.9, 60.0))
    way = 1000.0 + 3000.0 * np.clip((t - 60.0) / 280.0, 0.0, 1.0)
    (leg,) = legs_of(stops_of(t, way, speed, LINE.stations))
    halt = halt_of(leg, t, speed, np.full(400, np.nan))
    assert halt is not None
    assert halt.still_s == pytest.approx(340.0 - V_RAMP_MPS / 0.9 * (1.0 - HALT.share) + HALT.fixed_s, abs=1e-6)
    assert speed[halt.first] >= V_RAMP_MPS > speed[halt.first + 1]


def test_stops_away_from_stations_lie_within_a_leg() -> None:
    t = np.arange(0.0, 500.0, 1.0)
    speed = np.where((t < 40.0) | ((t > 200.0) & (t < 240.0)) | (t > 460.0), 0.0, 15.0)
    way = 1000.0 + np.concatenate(([0.0], np.cumsum(speed[1:])))
    way = 1000.0 + (way - 1000.0) * 3000.0 / (way[-1] - 1000.0)
    (leg,) = legs_of(stops_of(t, way, speed, LINE.stations))
    assert (leg.start.station, leg.end.station) == LINE.stations[:2]
