"""Runs with known times and energies, and logs with everything wrong that logs have."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.line import Line, SpeedLimit, Station
from services.line.alignment import alignment_of
from services.run_history.fixes import run_log
from services.run_history.least_time import least_time_s
from services.run_history.run_analysis import analyse_run
from services.run_history.traction_energy import JOULE_PER_KWH
from tests.unit.run_history.made_runs import (
    FULL_MPS,
    LINE,
    STAND_S,
    TRAIN,
    WAY,
    ZERO_S,
    joined,
    leg_speed,
    leg_time_s,
    made_run,
    part,
    result_of,
    with_speed,
)

TIME_S = 1.6
"""A made train starts without a jerk and stops without creeping; half of what ramps allow for real ones."""


def names(log_result: object) -> list[tuple[str, str]]:
    return [(leg.start.name, leg.end.name) for leg in log_result.legs]  # type: ignore[attr-defined]  # any result


@pytest.mark.parametrize("up", [True, False])
def test_legs_and_running_times_in_both_directions(up: bool) -> None:  # noqa: FBT001 - a case
    result = result_of(made_run(up=up))
    assert names(result) == ([("A", "B"), ("B", "C")] if up else [("C", "B"), ("B", "A")])
    for leg, length_m in zip(result.legs, (3000.0, 4000.0) if up else (4000.0, 3000.0), strict=True):
        assert leg.direction == ("up" if up else "down")
        assert leg.excluded_because == ""
        # Two ramps, each off by up to TIME_S the same way.
        assert leg.running_time_s == pytest.approx(leg_time_s(length_m), abs=2 * TIME_S)
    assert result.legs[0].ends.departure_s == pytest.approx(ZERO_S + STAND_S, abs=TIME_S)


def test_traction_energy_in_closed_form() -> None:
    leg = result_of(made_run()).legs[0]
    rise_s = FULL_MPS / 0.7
    cruise_s = leg_time_s(3000.0) - 2.0 * rise_s
    kinetic_j = 0.5 * TRAIN.inertial_mass_kg * FULL_MPS**2
    a, _, c = TRAIN.coefficients()
    rising_j = a * FULL_MPS * rise_s / 2.0 + c * FULL_MPS**3 * rise_s / 4.0
    cruising_j = (a + c * FULL_MPS**2) * FULL_MPS * cruise_s
    expected_kwh = (kinetic_j + rising_j + cruising_j) / JOULE_PER_KWH
    # Smoothing rounds the corners of the speed: less than three per cent of a leg of 3 km.
    assert leg.energy.wheel_kwh == pytest.approx(expected_kwh, rel=0.03)
    assert leg.energy.traction_kwh == pytest.approx(leg.energy.wheel_kwh / 0.85)
    assert 0.0 < leg.energy.sigma_kwh < 0.2 * leg.energy.traction_kwh


def test_the_articles_window_takes_the_assumed_ramps() -> None:
    leg = analyse_run(made_run(noise=0.0), [WAY], LINE.stations, TRAIN, 7.0).legs[0]
    v_stop = 8.0 / 3.6
    assert leg.ends.rising_s - leg.ends.departure_s == pytest.approx(v_stop / 0.48)
    assert leg.ends.arrival_s - leg.ends.falling_s == pytest.approx(v_stop / 0.60)


def test_speeds_in_kmh_are_found_out() -> None:
    log = made_run()
    plain, kmh = result_of(log), result_of(with_speed(log, log.speed_mps * 3.6))
    assert "km/h" in kmh.note
    assert kmh.legs[0].energy.traction_kwh == pytest.approx(plain.legs[0].energy.traction_kwh)


def test_a_log_without_speeds_is_derived_from_places_and_says_so() -> None:
    log = made_run()
    result = result_of(with_speed(log, np.full(len(log.t_unix_s), np.nan)))
    assert "derived from places" in result.note
    # Places of 2 m tell the time of a start less sharply than speeds: some seconds at each end.
    assert result.legs[0].running_time_s == pytest.approx(leg_time_s(3000.0), abs=6.0)
    assert result.legs[0].quality == pytest.approx(0.6)


def test_another_railway_is_said() -> None:
    log = made_run()
    result = result_of(replace(log, lon_deg=log.lon_deg + 0.3))
    assert result.legs == ()
    assert "another railway" in result.note


@pytest.mark.parametrize("n", [0, 1, 19])
def test_too_few_fixes_are_said(n: int) -> None:
    log = made_run()
    result = result_of(part(log, np.arange(len(log.t_unix_s)) < n))
    assert result.legs == ()
    assert "too few" in result.note


def test_a_log_cut_in_mid_leg_gives_the_whole_legs_alone() -> None:
    log = made_run()
    result = result_of(part(log, log.t_unix_s < ZERO_S + STAND_S + leg_time_s(3000.0) + STAND_S + 60.0))
    assert names(result) == [("A", "B")]
    late = result_of(part(log, log.t_unix_s > ZERO_S + STAND_S + 60.0))
    assert ("B", "C") in names(late)
    assert ("A", "B") not in names(late)


def test_a_turn_back_at_the_terminus_is_two_directions() -> None:
    there = made_run()
    back = made_run(up=False, zero_s=float(there.t_unix_s[-1]) + 300.0)
    result = result_of(joined(there, back))
    assert names(result) == [("A", "B"), ("B", "C"), ("C", "B"), ("B", "A")]
    assert [leg.direction for leg in result.legs] == ["up", "up", "down", "down"]
    assert all(leg.excluded_because == "" for leg in result.legs)


def test_where_the_line_runs_back_beside_itself_each_station_is_met_on_its_own_passage() -> None:
    # North for 5 km, a loop of 80 m, and south again 80 m beside: fixes of 2 m never say which passage alone.
    there = [(135.0, 35.0 + k * 0.001) for k in range(46)]
    back = [(135.0 + 80.0 / 91_100.0, lat) for _, lat in reversed(there)]
    loop = Line(id="l", name="L", axis=tuple((lon, lat, 0.0) for lon, lat in there + back))
    way = alignment_of(loop)
    middle_m = way.length_m / 2.0
    calls = (1000.0, middle_m - 500.0, middle_m + 3500.0)
    stations = tuple(Station(id=f"s{k}", name=f"S{k}", axis_m=at) for k, at in enumerate(calls))
    t = np.arange(0.0, 700.0, 1.0)
    second_s = 2.0 * STAND_S + leg_time_s(calls[1] - calls[0])
    speed = leg_speed(calls[1] - calls[0], t - STAND_S) + leg_speed(calls[2] - calls[1], t - second_s)
    place = calls[0] + np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))))
    rng = np.random.default_rng(11)
    lat, lon, _ = way.position(place)
    log = run_log("loop", ZERO_S + t, lat + rng.normal(0.0, 2e-5, len(t)), lon + rng.normal(0.0, 2e-5, len(t)), speed)
    result = analyse_run(log, [way], stations, TRAIN)
    assert names(result) == [("S0", "S1"), ("S1", "S2")]
    assert all(leg.direction == "up" and leg.excluded_because == "" for leg in result.legs)
    assert result.legs[1].running_time_s == pytest.approx(leg_time_s(calls[2] - calls[1]), abs=2 * TIME_S)


def test_the_wrong_line_beside_the_right_one_gives_no_leg_that_counts() -> None:
    # A railway that leaves ours after its second kilometre: the rest of the fixes lie nowhere on the line.
    log = made_run()
    beyond = np.clip(log.lat_deg - 35.02, 0.0, None)
    result = result_of(replace(log, lon_deg=log.lon_deg + beyond))
    assert all(leg.excluded_because for leg in result.legs)


def test_midnight_is_no_event() -> None:
    midnight_s = 1_700_006_400.0  # 2023-11-15T00:00:00Z
    over = result_of(made_run(zero_s=midnight_s - 100.0))
    plain = result_of(made_run())
    assert over.legs[0].running_time_s == pytest.approx(plain.legs[0].running_time_s, abs=1e-6)


def test_a_clock_that_is_off_moves_times_and_nothing_else() -> None:
    early, late = result_of(made_run()), result_of(made_run(zero_s=ZERO_S + 37.4))
    for one, other in zip(early.legs, late.legs, strict=True):
        assert other.ends.departure_s - one.ends.departure_s == pytest.approx(37.4, abs=1e-3)
        assert other.energy.traction_kwh == pytest.approx(one.energy.traction_kwh, rel=1e-6)


@pytest.mark.parametrize("apart_s", [1.3, 5.3, 60.4])
def test_two_devices_with_different_clocks_under_one_run_are_said(apart_s: float) -> None:
    both = joined(made_run(), made_run(zero_s=ZERO_S + apart_s))
    result = result_of(run_log("both", both.t_unix_s, both.lat_deg, both.lon_deg, both.speed_mps))
    assert result.legs == ()
    assert "two devices" in result.note


def test_fixes_at_the_same_times_are_left_out_and_told() -> None:
    both = joined(made_run(), made_run(zero_s=ZERO_S + 60.0))
    result = result_of(run_log("both", both.t_unix_s, both.lat_deg, both.lon_deg, both.speed_mps))
    assert "rows left out" in result.note
    assert result.legs[0].running_time_s == pytest.approx(leg_time_s(3000.0), abs=2 * TIME_S)


def test_a_gap_under_way_leaves_a_leg_out_and_one_in_a_stop_does_not() -> None:
    log = made_run()
    t = log.t_unix_s - ZERO_S
    under_way = result_of(part(log, (t < 100.0) | (t > 130.0)))
    assert "gap of 3" in under_way.legs[0].excluded_because
    assert under_way.legs[0].quality == 0.0
    standing = result_of(part(log, (t < 5.0) | (t > 30.0)))
    assert standing.legs[0].excluded_because == ""


def test_a_train_held_between_stations_is_left_out() -> None:
    log = made_run()
    t = log.t_unix_s - ZERO_S
    middle = int(np.searchsorted(t, 120.0))
    waits = np.arange(1.0, 91.0)
    held = [np.insert(one, middle, np.full(90, one[middle])) for one in (log.lat_deg, log.lon_deg)]
    times = np.concatenate((log.t_unix_s[:middle], log.t_unix_s[middle] + waits, log.t_unix_s[middle:] + 91.0))
    speed = np.insert(log.speed_mps, middle, np.zeros(90))
    result = result_of(replace(log, t_unix_s=times, lat_deg=held[0], lon_deg=held[1], speed_mps=speed))
    assert "held between stations" in result.legs[0].excluded_because


def test_a_departure_that_the_places_contradict_is_left_out() -> None:
    log = made_run()
    t = log.t_unix_s - ZERO_S
    speed = np.where((t > STAND_S) & (t < STAND_S + 16.0), 0.0, log.speed_mps)
    speed = np.where((t >= STAND_S + 16.0) & (t < STAND_S + 60.0), (t - STAND_S - 16.0) * 0.8 + 1.5, speed)
    result = result_of(with_speed(log, np.minimum(speed, FULL_MPS)))
    assert "at the departure" in result.legs[0].excluded_because


def test_a_stop_that_no_speed_tells_of_leaves_a_leg_out() -> None:
    # The last speed before the stop is one of 17 m/s: where the train braked from there nobody knows.
    log = made_run()
    before_s = log.t_unix_s - ZERO_S - STAND_S - leg_time_s(3000.0)
    silent = (before_s > -24.0) & (before_s < 5.0)
    legs = result_of(with_speed(log, np.where(silent, np.nan, log.speed_mps))).legs
    assert "between a stop and the next credible speed" in legs[0].excluded_because
    assert legs[1].excluded_because == ""


def test_a_frozen_receiver_is_judged_by_its_places_and_says_so() -> None:
    log = made_run()
    result = result_of(with_speed(log, np.where(log.speed_mps > 1.0, 12.3, log.speed_mps)))
    assert "repeat one value" in result.note
    for leg, length_m in zip(result.legs, (3000.0, 4000.0), strict=True):
        assert leg.excluded_because == ""
        assert leg.quality == pytest.approx(0.6)
        assert float(leg.speed_mps.max()) == pytest.approx(FULL_MPS, abs=1.0)
        # Places of 2 m tell a start to some seconds.
        assert leg.running_time_s == pytest.approx(leg_time_s(length_m), abs=6.0)


def test_a_train_on_cruise_control_is_no_frozen_receiver() -> None:
    log = made_run()
    rounded = np.round(np.where(log.speed_mps > FULL_MPS - 0.5, FULL_MPS, log.speed_mps) * 36.0) / 36.0
    plain, held = result_of(log), result_of(with_speed(log, rounded))
    for one, other in zip(plain.legs, held.legs, strict=True):
        assert other.excluded_because == ""
        assert other.energy.traction_kwh == pytest.approx(one.energy.traction_kwh, rel=0.02)


def test_the_least_time_is_that_of_a_trapezium() -> None:
    # 3000 m less 100 m for where trains stop, at 33.3 m/s and 1.5 m/s²; steps of 25 m cut the corners by a second.
    assert least_time_s(WAY, 1000.0, 4000.0, 33.3) == pytest.approx(2900.0 / 33.3 + 33.3 / 1.5, abs=1.0)
    assert least_time_s(WAY, 4000.0, 1000.0, 33.3) == pytest.approx(least_time_s(WAY, 1000.0, 4000.0, 33.3))
    limit = SpeedLimit(start_axis_m=0.0, end_axis_m=9000.0, limit_mps=10.0)
    slow = alignment_of(msgspec.structs.replace(LINE, speed_limits=(limit,)))
    assert least_time_s(slow, 1000.0, 4000.0, 33.3) == pytest.approx(2900.0 / 11.0 + 11.0 / 1.5, abs=1.0)


def test_a_leg_faster_than_line_and_vehicle_allow_is_left_out() -> None:
    log = made_run()
    fast = result_of(replace(log, t_unix_s=ZERO_S + (log.t_unix_s - ZERO_S) / 2.0, speed_mps=log.speed_mps * 2.0))
    assert fast.legs
    assert all("faster than line and vehicle allow" in leg.excluded_because for leg in fast.legs)
    assert all(leg.quality == 0.0 for leg in fast.legs)


@given(seed=st.integers(0, 1000), gone=st.floats(0.0, 0.5))
def test_whatever_a_log_lost_a_counted_leg_is_no_nonsense(seed: int, gone: float) -> None:
    log = made_run()
    rng = np.random.default_rng(seed)
    speed = np.where(rng.random(len(log.t_unix_s)) < gone / 2.0, 0.0, log.speed_mps)
    result = result_of(part(with_speed(log, speed), rng.random(len(log.t_unix_s)) >= gone))
    for leg in result.legs:
        if not leg.excluded_because:
            length_m = abs(leg.end.axis_m - leg.start.axis_m)
            assert leg.running_time_s == pytest.approx(leg_time_s(length_m), abs=15.0)
            assert 0.0 < leg.energy.traction_kwh < 30.0
