from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.motion_sensors.pulse_counter import PulseCounter
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
