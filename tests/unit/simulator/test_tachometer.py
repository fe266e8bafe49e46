from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.simulator.motion_settings import AXLE_LOAD_CONTROLLED, CONVENTIONAL, Tacho
from services.simulator.tachometer import Tachometer

RIM_M = np.pi * 0.816


def tachometer(tacho: Tacho | None = None, seed: int = 1) -> Tachometer:
    return Tachometer(tacho or Tacho(wheel_scale=0.0), CONVENTIONAL, np.random.default_rng(seed))


@given(way_m=st.floats(0.0, 1e5), seed=st.integers(0, 50))
def test_counts_are_path_over_circumference_times_teeth(way_m: float, seed: int) -> None:
    # One count is 28.5 mm; where the first tooth stands is drawn, so the count is off by less than one.
    count = tachometer(seed=seed).counts(np.array([way_m]))[0]
    assert abs(count - way_m / RIM_M * 90) <= 1.0


def test_the_paper_s_second_vehicle_has_102_teeth_on_502_mm() -> None:
    counter = Tachometer(Tacho(wheel_scale=0.0), AXLE_LOAD_CONTROLLED, np.random.default_rng(1))
    assert counter.counts(np.array([np.pi * 0.502 * 1000]))[0] == pytest.approx(102_000, abs=1)


def test_a_worn_wheel_counts_more() -> None:
    counter = tachometer(Tacho(wheel_scale=-0.01))
    assert counter.diameter_m == pytest.approx(0.816 * 0.99)
    assert counter.counts(np.array([RIM_M * 99.0]))[0] == pytest.approx(9000, abs=1)


@given(missing=st.integers(0, 89))
def test_missing_teeth_are_missing_once_per_revolution(missing: int) -> None:
    counter = tachometer(Tacho(wheel_scale=0.0, missing_teeth=missing))
    counts = counter.counts(np.arange(0.0, RIM_M * 10.0, RIM_M / 900))
    assert counts[-1] - counts[0] == pytest.approx((90 - missing) * 10, abs=missing + 1)
    assert np.all(np.diff(counts) >= 0)


def test_teeth_that_break_off_do_not_change_what_was_counted() -> None:
    counter = tachometer()
    before = counter.counts(np.array([RIM_M * 100.2]))[0]
    after = counter.counts(np.array([RIM_M * 100.2]), 9)[0]
    later = counter.counts(np.array([RIM_M * 200.2]), 9)[0]
    assert after == before
    assert later - after == pytest.approx(81 * 100, abs=1)


def test_narrow_counters_wrap_and_counters_begin_anew() -> None:
    counter = tachometer(Tacho(wheel_scale=0.0, counter_bits=8))
    counts = counter.counts(np.arange(0.0, RIM_M * 10.0, RIM_M / 90))
    assert counts.max() == 255
    assert set(np.diff(counts)) <= {0, 1, 2, -255, -254}
    counter = tachometer()
    counter.counts(np.array([RIM_M * 50.0]))
    counter.reset()
    assert counter.counts(np.array([RIM_M * 51.0]))[0] == 90


def test_only_some_counters_tell_direction() -> None:
    back = np.array([0.0, -RIM_M])
    assert np.diff(tachometer().counts(back)) == [-90]
    assert np.diff(tachometer(Tacho(wheel_scale=0.0, tells_direction=False)).counts(back)) == [90]
