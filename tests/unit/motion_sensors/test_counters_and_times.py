from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.motion_sensors.axle_watch import RECENT_S, Recently
from services.motion_sensors.pulse_counter import PulseCounter
from services.motion_sensors.sample_rhythm import WINDOW_S
from services.motion_sensors.sample_times import DRIFT, SampleTimes


@given(
    steps=st.lists(st.integers(-40, 40), min_size=1, max_size=60),
    bits=st.integers(8, 32),
    start=st.integers(0, 2**32 - 1),
)
def test_any_wrap_is_unwound(steps: list[int], bits: int, start: int) -> None:
    counter = PulseCounter(modulus=1 << bits, largest_hz=500.0)
    true = start
    counter.read(true % (1 << bits), 0.0)
    for k, step in enumerate(steps, 1):
        true += step
        assert counter.read(true % (1 << bits), 0.1 * k) == true - start
    assert counter.resets == 0


def test_a_counter_that_begins_anew_adds_what_it_has_counted_since() -> None:
    counter = PulseCounter(modulus=0, largest_hz=500.0)
    assert [counter.read(raw, 0.1 * k) for k, raw in enumerate((90_000, 90_030, 12, 42))] == [0, 30, 42, 72]
    assert counter.resets == 1


def test_a_leap_to_nonsense_adds_nothing() -> None:
    counter = PulseCounter(modulus=0, largest_hz=500.0)
    assert [counter.read(raw, 0.1 * k) for k, raw in enumerate((100, 130, 10**9, 10**9 + 30))] == [0, 30, 30, 60]
    assert counter.resets == 1


def test_pulses_after_a_gap_count_as_far_as_a_train_could_go() -> None:
    counter = PulseCounter(modulus=0, largest_hz=500.0)
    counter.read(0, 0.0)
    assert counter.read(4000, 10.0) == 4000
    assert counter.resets == 0


@given(delays=st.lists(st.floats(0.0, 0.2), min_size=50, max_size=120))
def test_buffers_delay_but_stamps_keep_the_sensors_rhythm(delays: list[float]) -> None:
    delays[0] = 0.0
    times = SampleTimes(interval_s=0.01, latency_s=0.003)
    stamps = [times.stamp(100.0 + 0.01 * k + delay, None, None) for k, delay in enumerate(delays)]
    # The envelope may rise by DRIFT per second of host time, never more.
    tolerance_s = DRIFT * (0.01 * len(delays) + 0.4) + 1e-4
    assert stamps == pytest.approx([99.997 + 0.01 * k for k in range(len(delays))], abs=tolerance_s)
    assert times.restarts == 0


def test_missing_samples_are_counted_by_the_sensors_own_counter() -> None:
    times = SampleTimes(0.01, 0.0, counter_modulus=256)
    stamps = [times.stamp(1.0 + 0.01 * k, (250 + k) % 256, None) for k in (0, 1, 2, 10, 11)]
    assert times.lost == 7
    assert times.samples == 12
    assert stamps[3] - stamps[2] == pytest.approx(0.08, abs=1e-4)


def test_a_sensor_that_starts_again_is_tied_anew() -> None:
    times = SampleTimes(0.01, 0.0)
    times.stamp(10.0, None, 500.0)
    times.stamp(10.01, None, 500.01)
    assert times.stamp(12.0, None, 0.0) == pytest.approx(12.0)
    assert times.restarts == 1


@given(
    arrivals=st.lists(
        st.tuples(st.floats(0.0, 1e6), st.none() | st.integers(0, 255), st.none() | st.floats(-1e6, 1e6)), max_size=50
    )
)
def test_stamps_never_go_back(arrivals: list[tuple[float, int | None, float | None]]) -> None:
    times = SampleTimes(0.01, 0.1, counter_modulus=256)
    stamps = [times.stamp(*arrival) for arrival in arrivals]
    assert all(after > before for before, after in itertools.pairwise(stamps))


def test_a_narrow_counter_that_may_have_wrapped_unseen_says_so() -> None:
    counter = PulseCounter(modulus=1 << 16, largest_hz=4500.0)
    counter.read(65_000, 0.0)
    assert (counter.read(500, 5.0), counter.resets) == (1036, 0)
    # In 10 s a fast train turns it by 45,000: 1,000 more may be 66,536 more.
    assert (counter.read(1500, 15.0), counter.resets) == (2036, 1)


@pytest.mark.parametrize("off", [-0.03, 0.01, 0.03])
def test_a_sensor_that_is_not_as_fast_as_its_data_sheet_is_stamped_right(off: float) -> None:
    times = SampleTimes(0.01, 0.0, counter_modulus=1 << 16)
    true = [100.0 + 0.01 * (1.0 + off) * k for k in range(6000)]
    # Every third sample comes 5 ms late.
    stamps = [times.stamp(one + 0.005 * (k % 3), k, None) for k, one in enumerate(true)]
    known = round(3.0 * WINDOW_S / 0.01)
    assert stamps[known:] == pytest.approx(true[known:], abs=0.006)
    assert (times.restarts, times.lost) == (0, 0)


@pytest.mark.parametrize("own_clock", [False, True])
@pytest.mark.parametrize("held_s", [0.0, 2.0])
def test_samples_that_waited_for_seconds_keep_their_times(held_s: float, *, own_clock: bool) -> None:
    """Between 20 s and 30 s everything is late: by 2 s, or all of it comes at once at the end."""
    times = SampleTimes(0.01, 0.0, counter_modulus=0 if own_clock else 1 << 16)
    true = [0.01 * k for k in range(6000)]
    arrived, stamps = 0.0, []
    for k, one in enumerate(true):
        waiting = 20.0 < one < 28.0
        arrived = max(arrived, (one + held_s if held_s else 28.0) if waiting else one)
        stamps.append(times.stamp(arrived, None if own_clock else k, 700.0 + one if own_clock else None))
    # The envelope rises by DRIFT while nothing comes in time.
    assert stamps == pytest.approx(true, abs=10.0 * DRIFT)
    assert times.restarts == 0


def test_a_clock_that_is_none_is_passed_over() -> None:
    times = SampleTimes(0.01, 0.0)
    assert times.stamp(50.0, None, 1e300) == pytest.approx(50.0)
    assert times.stamp(50.01, None, float("nan")) == pytest.approx(50.01)


def test_what_began_anew_is_said_for_a_minute_and_again() -> None:
    recently = Recently()
    said = [recently.grown(count, time_s) for count, time_s in ((0, 0.0), (1, 5.0), (1, 5.0 + RECENT_S), (2, 99.0))]
    assert said == [False, True, False, True]
