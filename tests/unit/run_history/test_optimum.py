"""The optimum against an independent search, and what every profile must keep."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.line import SpeedLimit
from services.line.alignment import alignment_of
from services.run_history.driving_advice import advice_of
from services.run_history.optimum import Optimum, OptimumError, Section, fastest_run, optimum, section_between
from services.run_history.optimum_report import report_lines, report_of
from services.run_history.vehicle import Vehicle
from tests.unit.run_history.made_runs import LINE, TRAIN, WAY, Floats

TRACTION = Vehicle(name="flat", mass_t=120.0, max_speed_mps=30.0)
LENGTH_M = 8000.0
FLAT = Section(np.linspace(0.0, LENGTH_M, 801), np.zeros(801), np.full(801, 30.0))
DV = 0.01


@dataclass(frozen=True)
class Phase:
    """Distance, time and energy from standstill up to each speed of a grid (or down from it)."""

    way_m: Floats
    time_s: Floats
    joules: Floats


def phase(v: Floats, change: Floats, force: Floats) -> Phase:
    middle = 0.5 * (v[1:] + v[:-1])
    seconds = DV / change
    steps = (middle * seconds, seconds, force * middle * seconds)
    return Phase(*(np.concatenate(([0.0], np.cumsum(one))) for one in steps))


def cheapest_of_four_phases(vehicle: Vehicle, length_m: float, time_s: float) -> float:
    """Energy [kWh] of the best accelerate, hold, coast, brake, found by trying them."""
    v = np.arange(0.0, vehicle.max_speed_mps + DV, DV)
    middle = 0.5 * (v[1:] + v[:-1])
    mass, drag = vehicle.inertial_mass_kg, vehicle.resistance_n(middle)
    most = np.minimum(vehicle.max_tractive_kn * 1e3, vehicle.max_power_kw * 1e3 / middle)
    rise = np.minimum((most - drag) / mass, vehicle.max_acceleration_mps2)
    up = phase(v, rise, mass * rise + drag)
    roll = phase(v, drag / mass, np.zeros_like(middle))
    stop = phase(v, np.full_like(middle, vehicle.service_brake_mps2), np.zeros_like(middle))
    best = np.inf
    for top in range(500, len(v), 5):
        down = np.arange(1, top + 1)
        hold_m = length_m - up.way_m[top] - (roll.way_m[top] - roll.way_m[down]) - stop.way_m[down]
        times = up.time_s[top] + hold_m / v[top] + roll.time_s[top] - roll.time_s[down] + stop.time_s[down]
        fits = (hold_m >= 0.0) & (times <= time_s)
        if fits.any():
            cost = up.joules[top] + float(vehicle.resistance_n(v[top])) * hold_m
            best = min(best, float(cost[fits].min()))
    return best / vehicle.line_to_wheel / 3.6e6


@pytest.mark.parametrize("time_s", [360.0, 400.0, 460.0])
def test_on_the_flat_it_is_as_cheap_as_an_independent_search(time_s: float) -> None:
    found = optimum(FLAT, TRACTION, time_s)
    assert found.running_time_s == pytest.approx(time_s, abs=0.001)
    expected = cheapest_of_four_phases(TRACTION, LENGTH_M, time_s)
    # Half a per cent is what the method promises; the search tries whole hundredths of a metre per second.
    assert found.traction_kwh == pytest.approx(expected, rel=0.005)


def kept(section: Section, vehicle: Vehicle, found: Optimum) -> None:
    """What physics and limits ask of a profile."""
    step_m = abs(section.axis_m[1] - section.axis_m[0])
    assert found.speed_mps[0] == 0.0
    assert found.speed_mps[-1] == pytest.approx(0.0, abs=0.05)
    assert (found.speed_mps <= section.limit_mps + 1e-3).all()
    assert (np.diff(found.time_s) > 0.0).all()
    change = np.diff(found.speed_mps**2) / (2.0 * step_m)
    # The last step ends the run on a grid of speeds.
    assert change.max() <= vehicle.max_acceleration_mps2 + 0.02
    assert change[:-1].min() >= -vehicle.service_brake_mps2 - 0.05


@settings(max_examples=8)
@given(climb=st.floats(-15.0, 15.0), slack=st.floats(1.05, 1.5))
def test_profiles_keep_limits_traction_and_brakes(climb: float, slack: float) -> None:
    section = Section(
        FLAT.axis_m[:301],
        np.full(301, float(TRACTION.track_force_n(climb, 0.0))),
        np.where(np.arange(301) // 100 == 1, 15.0, 28.0),
    )
    fastest = fastest_run(section, TRACTION)
    kept(section, TRACTION, fastest)
    found = optimum(section, TRACTION, fastest.running_time_s * slack)
    kept(section, TRACTION, found)
    assert found.running_time_s <= fastest.running_time_s * slack + 0.2
    assert found.traction_kwh <= fastest.traction_kwh + 1e-6


def test_more_time_never_costs_more() -> None:
    energies = [optimum(FLAT, TRACTION, time_s).traction_kwh for time_s in (350.0, 370.0, 400.0, 450.0)]
    assert energies == sorted(energies, reverse=True)


def test_what_cannot_be_is_said() -> None:
    with pytest.raises(OptimumError, match="no faster than"):
        optimum(FLAT, TRACTION, 100.0)
    with pytest.raises(OptimumError, match="too short"):
        section_between(WAY, TRAIN, 1000.0, 1100.0)
    steep = Section(FLAT.axis_m, np.full(801, 1e7), FLAT.limit_mps)
    with pytest.raises(OptimumError, match="cannot get through"):
        optimum(steep, TRACTION, 400.0)


def test_limits_hold_until_the_rear_end_has_left() -> None:
    limited = LINE.__class__(
        id="x",
        name="x",
        axis=LINE.axis,
        speed_limits=(SpeedLimit(start_axis_m=2000.0, end_axis_m=2500.0, limit_mps=10.0),),
    )
    section = section_between(alignment_of(limited), TRAIN, 1000.0, 4000.0)
    slow = section.axis_m[section.limit_mps <= 10.0]
    assert slow.min() == pytest.approx(2000.0, abs=10.0)
    assert slow.max() == pytest.approx(2500.0 + TRAIN.length_m, abs=20.0)


def test_advice_covers_the_section_and_the_report_says_the_price() -> None:
    report = report_of(WAY, TRAIN, LINE.stations[0], LINE.stations[1], 195.0)
    advice = advice_of(report.profile)
    assert advice[0].what == "accelerate"
    assert advice[-1].what == "brake"
    assert advice[0].from_axis_m == LINE.stations[0].axis_m
    assert advice[-1].until_axis_m == pytest.approx(LINE.stations[1].axis_m)
    assert all(one.until_axis_m == other.from_axis_m for one, other in pairwise(advice))
    assert report.price_kwh_per_s > 0.0
    energies = [kwh for _, kwh in report.curve if kwh is not None]
    assert energies == sorted(energies, reverse=True)
    assert any("one second less costs" in text for text in report_lines(report))
