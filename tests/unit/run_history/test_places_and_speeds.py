"""What places say about a log's offset, about the lag of its speeds, and about its ramps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.run_history.place_offset import along_m, common_offset
from services.run_history.ramp_places import PLACE_SIGMA_M, earlier_s
from services.run_history.run_analysis import analyse_run
from services.run_history.speed_lag import speed_lag_s
from tests.unit.run_history.made_runs import LINE, TRAIN, WAY, Floats, made_run, part, result_of

T = np.arange(0.0, 1200.0, 1.0)
WEAVE = np.clip(10.0 + 8.0 * np.sin(T / 40.0), 0.0, None)
WAY_M = np.concatenate(([0.0], np.cumsum(0.5 * (WEAVE[1:] + WEAVE[:-1]))))


def across(offset: tuple[float, float], heading: Floats) -> Floats:
    """Distance to the left of the axis that an offset causes."""
    return np.asarray(-offset[0] * np.cos(heading) + offset[1] * np.sin(heading))


@given(east=st.floats(-10.0, 10.0), north=st.floats(-10.0, 10.0), side=st.floats(-2.0, 2.0))
def test_an_offset_is_found_where_the_line_turns(east: float, north: float, side: float) -> None:
    heading = WAY_M / 2000.0
    found = common_offset(T, WAY_M, across((east, north), heading) + side, heading)
    # The priors (10 m, 2.5 m) pull a little: twelve blocks of 100 s with 7 m each know it to about 3 m.
    assert found == pytest.approx((east, north), abs=4.0)


@given(east=st.floats(-10.0, 10.0))
def test_on_a_line_that_never_turns_what_lies_along_it_stays(east: float) -> None:
    heading = np.zeros(len(T))  # northwards: an offset to the east is seen, one to the north is not
    found = common_offset(T, WAY_M, across((east, 9.0), heading), heading)
    assert abs(found[1]) < 1e-9
    assert float(np.abs(along_m(found, heading)).max()) < 1e-9


def test_nothing_known_is_no_offset() -> None:
    nothing = np.full(5, np.nan)
    assert common_offset(T[:5], nothing, nothing, nothing) == (0.0, 0.0)


@given(lag_s=st.floats(-1.5, 1.5), seed=st.integers(0, 1000))
def test_the_lag_of_speeds_is_found_from_the_log_alone(lag_s: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    speed = np.interp(T - lag_s, T, WEAVE) + rng.normal(0.0, 0.1, len(T))
    # Places of 2 m over windows of 20 s that gain some 4 m/s: a sixtieth of a run of 20 minutes tells 0.6 s.
    assert speed_lag_s(T, WAY_M + rng.normal(0.0, 2.0, len(T)), speed) == pytest.approx(lag_s, abs=0.35)


def test_steady_speeds_and_few_fixes_tell_no_lag() -> None:
    assert speed_lag_s(T, 10.0 * T, np.full(len(T), 10.0)) == 0.0
    assert speed_lag_s(T[:10], WAY_M[:10], WEAVE[:10]) == 0.0
    assert speed_lag_s(T, WAY_M, np.full(len(T), np.nan)) == 0.0
    assert speed_lag_s(T, WAY_M, np.where(T % 5 < 3, np.nan, np.interp(T - 1.0, T, WEAVE))) == 0.0
    assert speed_lag_s(T, WAY_M, np.interp(T - 4.0, T, WEAVE)) == 0.0


def test_late_speeds_change_times_of_day_by_their_lag_and_are_told() -> None:
    log = made_run()
    later = replace(log, speed_mps=np.interp(log.t_unix_s - 1.4, log.t_unix_s, log.speed_mps))
    plain, late = result_of(log), result_of(later)
    assert "after its places" in late.note
    assert plain.note == ""
    for one, other in zip(plain.legs, late.legs, strict=True):
        # Set back by the lag that was found, each departure is where it was; a run of 2 m fixes tells it to 0.3 s.
        assert other.ends.departure_s == pytest.approx(one.ends.departure_s, abs=0.6)
        assert other.running_time_s == pytest.approx(one.running_time_s, abs=0.6)


def start(early_s: float) -> tuple[Floats, Floats, Floats, int]:
    """A start at 30 s whose speeds are right from 33 s on, with places of a train that left so much earlier."""
    t = np.arange(0.0, 60.0, 1.0)
    speed = np.clip((t - 30.0) * 0.8, 0.0, 20.0)
    moved = np.clip(t - 30.0 + early_s, 0.0, None) ** 2 * 0.4
    return t, moved, speed, 33


@given(early_s=st.floats(-1.0, 1.0))
def test_places_move_a_start_their_way_and_never_beyond_what_they_say(early_s: float) -> None:
    t, moved, speed, first = start(early_s)
    found = earlier_s(t, moved, speed, first, 31, 0.8, 1.0)
    assert found * early_s >= -1e-9
    assert abs(found) <= abs(early_s) + 1e-9


def test_places_that_say_nothing_or_nonsense_leave_a_start_alone() -> None:
    t, moved, speed, first = start(0.0)
    assert earlier_s(t, np.full(len(t), np.nan), speed, first, 31, 0.8, 1.0) == 0.0
    assert earlier_s(t, moved, speed, first, 5, 0.8, 1.0) == 0.0
    jumped = moved + np.where(t > 31.0, 100.0 * PLACE_SIGMA_M, 0.0)
    assert abs(earlier_s(t, jumped, speed, first, 31, 0.8, 1.0)) < 0.1


def test_speeds_that_contradict_the_places_leave_a_leg_out() -> None:
    log = made_run()
    t = log.t_unix_s - log.t_unix_s[0]
    wild = np.where((t > 60.0) & (t < 180.0), log.speed_mps * (1.0 + 0.5 * np.sign(np.sin(t / 6.0))), log.speed_mps)
    leg = analyse_run(replace(log, speed_mps=wild), [WAY], LINE.stations, TRAIN).legs[0]
    assert "contradict its places" in leg.excluded_because


def test_a_loss_of_speeds_that_places_bridge_is_no_contradiction() -> None:
    log = made_run()
    t = log.t_unix_s - log.t_unix_s[0]
    leg = result_of(replace(part(log, t >= 0.0), speed_mps=np.where((t > 90.0) & (t < 115.0), np.nan, log.speed_mps)))
    assert leg.legs[0].excluded_because == ""
