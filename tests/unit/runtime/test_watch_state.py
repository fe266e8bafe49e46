"""What a viewer makes of what it hears: ages, errors against truth, rates, losses."""

from __future__ import annotations

import math
from collections import deque

import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.gnss import Fix, FixStatus, Method
from schemas.health import Health, InputHealth, Level
from schemas.position import TrainTruth
from services.runtime.watch_state import (
    KEPT_ERRORS,
    LOST_AFTER_S,
    MAX_ROWS,
    STALE_AFTER_S,
    WatchState,
    horizontal_distance_m,
    truth_at,
)

SECOND_NS = 1_000_000_000
METRE_DEG = 1 / 110_574.0
"""A metre towards north at the equator [deg] (WGS 84: 110,574 m per degree)."""


def fix_at(t_s: float, north_m: float | None = 0.0, method: Method = "adjust", status: FixStatus | None = None) -> Fix:
    return Fix(
        t_ns=round(t_s * SECOND_NS),
        gps_week=2300,
        tow_s=t_s,
        method=method,
        status=status or ("none" if north_m is None else "fix"),
        reason="3 satellites" if north_m is None else "",
        lat_deg=None if north_m is None else north_m * METRE_DEG,
        lon_deg=None if north_m is None else 0.0,
        satellites_used=3 if north_m is None else 7,
        satellites_flagged=2,
    )


def truth(t_s: float, north_m: float = 0.0, surroundings: str = "street canyon") -> TrainTruth:
    return TrainTruth(
        t_ns=round(t_s * SECOND_NS),
        lat_deg=north_m * METRE_DEG,
        lon_deg=0.0,
        h_m=0.0,
        ve_mps=0.0,
        vn_mps=0.0,
        vu_mps=0.0,
        axis_m=0.0,
        speed_mps=0.0,
        surroundings=surroundings,
    )


def health(
    uptime_s: float, published: int, boot_id: str = "b1", level: Level = "ok", missing: int = 0, name: str = "x"
) -> Health:
    entry = InputHealth(key="k", source="s", received=1, missing=missing, duplicated=0, restarts=0, age_s=0, delay_s=0)
    return Health(
        t_ns=0,
        service=name,
        boot_id=boot_id,
        level=level,
        reasons=() if level == "ok" else ("no sky",),
        uptime_s=uptime_s,
        published=published,
        received=0,
        dropped=0,
        refused=0,
        inputs=(entry,),
    )


def test_an_error_waits_for_its_truth_and_is_found_between_two_samples() -> None:
    state = WatchState("demo")
    state.take_truth("T1", "front", truth(0.0, 0.0), heard_s=0.0)
    state.take_fix("T1", "front", fix_at(0.5, 12.0), primary=True, heard_s=0.5, delay_s=0.0)
    row = state.devices["T1", "front"].methods["adjust"]
    assert row.error_m is None
    state.take_truth("T1", "front", truth(1.0, 10.0), heard_s=1.0)
    # The true place half-way is 5 m; a metre in degrees is given to 1e-6 of itself.
    assert row.error_m == pytest.approx(7.0, rel=1e-4)


def test_truth_far_apart_gives_no_error() -> None:
    state = WatchState("demo")
    state.take_truth("T1", "front", truth(0.0), heard_s=0.0)
    state.take_fix("T1", "front", fix_at(1.5), primary=True, heard_s=0.0, delay_s=0.0)
    state.take_truth("T1", "front", truth(3.0), heard_s=0.0)
    row = state.devices["T1", "front"].methods["adjust"]
    assert row.error_m is None
    assert not row.pending


def test_truth_before_the_first_sample_is_unknown() -> None:
    truths = deque([truth(1.0), truth(1.2)])
    assert truth_at(truths, SECOND_NS // 2) is None
    assert truth_at(truths, 2 * SECOND_NS) is None
    assert truth_at(truths, SECOND_NS) == (0.0, 0.0)


def test_a_simulation_that_begins_anew_starts_over() -> None:
    state = WatchState("demo")
    state.take_truth("T1", "front", truth(100.0, 50.0), heard_s=0.0)
    state.take_fix("T1", "front", fix_at(101.0), primary=True, heard_s=0.0, delay_s=0.0)
    state.take_truth("T1", "front", truth(1.0, 0.0), heard_s=0.0)
    state.take_truth("T1", "front", truth(1.0, 0.0), heard_s=0.0)
    view = state.devices["T1", "front"]
    assert [entry.t_ns for entry in view.truths] == [SECOND_NS, SECOND_NS]
    state.take_fix("T1", "front", fix_at(1.0, 3.0), primary=True, heard_s=0.0, delay_s=0.0)
    assert view.methods["adjust"].error_m == pytest.approx(3.0, rel=1e-4)


def test_running_figures_of_a_method() -> None:
    state = WatchState("demo")
    for index in range(1, 101):
        state.take_truth("T1", "front", truth(float(index)), heard_s=index)
        state.take_fix("T1", "front", fix_at(float(index), float(index)), primary=True, heard_s=index, delay_s=0.0)
    row = state.devices["T1", "front"].methods["adjust"]
    assert row.mean_m() == pytest.approx(50.5, rel=1e-4)
    assert row.quantile_m(0.95) == pytest.approx(95.0, rel=1e-4)


@given(st.lists(st.floats(0.0, 1e5), min_size=1, max_size=50), st.floats(0.01, 1.0))
def test_a_quantile_is_an_error_that_enough_do_not_exceed(errors: list[float], share: float) -> None:
    state = WatchState("demo")
    state.take_fix("T1", "front", fix_at(0.0), primary=True, heard_s=0.0, delay_s=0.0)
    row = state.devices["T1", "front"].methods["adjust"]
    row.errors.extend((0.0, error) for error in errors)
    quantile = row.quantile_m(share)
    assert quantile in errors
    assert quantile is not None
    assert sum(error <= quantile for error in errors) >= share * len(errors) - 1e-9


def test_memory_stays_bounded() -> None:
    state = WatchState("demo")
    for index in range(KEPT_ERRORS + 100):
        state.take_truth("T1", "front", truth(float(index)), heard_s=index)
        state.take_fix("T1", "front", fix_at(float(index)), primary=True, heard_s=index, delay_s=0.0)
    for index in range(MAX_ROWS + 10):
        state.take_fix(f"T{index}", "front", fix_at(0.0), primary=True, heard_s=0.0, delay_s=0.0)
        state.take_health(f"demo/train/T{index}/x", health(1.0, 1), 0.0, 0.0)
    assert len(state.devices["T1", "front"].methods["adjust"].errors) == KEPT_ERRORS
    assert len(state.devices) == len(state.services) == MAX_ROWS
    assert state.crowded


def test_a_train_that_stops_sending_is_stale_and_its_age_grows() -> None:
    state = WatchState("demo")
    state.take_fix("T1", "front", fix_at(0.0), primary=True, heard_s=10.0, delay_s=0.1)
    row = state.devices["T1", "front"].methods["adjust"]
    assert not row.stale(10.0 + STALE_AFTER_S - 0.2)
    assert row.stale(10.0 + STALE_AFTER_S)
    assert row.age_s(100.0) == pytest.approx(90.1)


def test_a_late_joiners_old_fix_is_stale_at_once() -> None:
    state = WatchState("demo")
    state.take_fix("T1", "front", fix_at(0.0), primary=True, heard_s=10.0, delay_s=3600.0)
    assert state.devices["T1", "front"].methods["adjust"].stale(10.0)


def test_a_sender_whose_clock_is_ahead_has_no_negative_age() -> None:
    state = WatchState("demo")
    state.take_fix("T1", "front", fix_at(0.0), primary=True, heard_s=10.0, delay_s=-5.0)
    assert state.devices["T1", "front"].methods["adjust"].age_s(10.0) == 0.0


def test_an_epoch_without_a_fix_takes_the_error_away() -> None:
    state = WatchState("demo")
    state.take_truth("T1", "front", truth(0.0), heard_s=0.0)
    state.take_fix("T1", "front", fix_at(0.0, 4.0), primary=True, heard_s=0.0, delay_s=0.0)
    state.take_fix("T1", "front", fix_at(0.2, None), primary=True, heard_s=0.2, delay_s=0.0)
    row = state.devices["T1", "front"].methods["adjust"]
    assert row.error_m is None
    assert len(row.errors) == 1


def test_surroundings_are_forgotten_when_truth_stops() -> None:
    state = WatchState("demo")
    state.take_truth("T1", "front", truth(0.0), heard_s=5.0)
    view = state.devices["T1", "front"]
    assert view.surroundings(5.0) == "street canyon"
    assert view.surroundings(5.0 + STALE_AFTER_S + 0.1) == ""


def test_rates_restarts_and_losses_of_a_service() -> None:
    state = WatchState("demo")
    state.take_health("demo/train/T1/x", health(1.0, 100), heard_s=1.0, delay_s=0.0)
    assert state.services["demo/train/T1/x"].rate_hz is None
    state.take_health("demo/train/T1/x", health(2.0, 115, missing=3), heard_s=2.0, delay_s=0.0)
    view = state.services["demo/train/T1/x"]
    assert (view.rate_hz, view.missing(), view.restarts) == (15.0, 3, 0)
    assert not view.lost(2.0 + LOST_AFTER_S)
    assert view.lost(2.1 + LOST_AFTER_S)
    state.take_health("demo/train/T1/x", health(0.5, 2, boot_id="b2"), heard_s=9.0, delay_s=0.0)
    view = state.services["demo/train/T1/x"]
    assert (view.rate_hz, view.restarts, view.lost(9.0)) == (None, 1, False)


@pytest.mark.parametrize(
    ("lat_deg", "north_m", "east_m"),
    # Length of a degree on WGS 84, from the series of Snyder (1987), Map Projections, p. 25.
    [(0.0, 110_574.3, 111_319.5), (45.0, 111_131.8, 78_846.8), (60.0, 111_412.3, 55_800.0)],
)
def test_distances_agree_with_published_lengths_of_a_degree(lat_deg: float, north_m: float, east_m: float) -> None:
    small = 0.001
    north = horizontal_distance_m(lat_deg + small / 2, 10.0, lat_deg - small / 2, 10.0) / small
    east = horizontal_distance_m(lat_deg, 10.0 + small, lat_deg, 10.0) / small
    assert north == pytest.approx(north_m, rel=1e-6)  # the published figures have seven digits
    assert east == pytest.approx(east_m, rel=1e-6)


def test_the_date_line_is_no_distance() -> None:
    assert horizontal_distance_m(0.0, 179.9999, 0.0, -179.9999) == pytest.approx(0.0002 * 111_319.5, rel=1e-6)
    assert math.isclose(horizontal_distance_m(35.0, 135.0, 35.0, 135.0), 0.0)


def test_a_service_without_its_token_is_lost_before_its_report_is_old() -> None:
    state = WatchState("demo")
    state.take_health("demo/train/T1/a", health(10.0, 1, boot_id="first"), 100.0, 0.0)
    view = state.services["demo/train/T1/a"]
    state.take_alive("demo/train/T1/a", "another start", alive=False)
    assert not view.lost(101.0)
    state.take_alive("demo/train/T1/a", "first", alive=False)
    assert view.lost(101.0)
    state.take_alive("demo/train/T1/a", "first", alive=True)
    assert not view.lost(101.0)
    state.take_alive("demo/train/T1/unheard", "first", alive=False)
