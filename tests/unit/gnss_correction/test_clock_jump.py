"""Jumps of the receiver's clock."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from services.gnss_correction.clock_jump import MILLISECOND_M, TOLERANCE_M, clock_jump_ms

OTHER_M = st.floats(-0.9 * TOLERANCE_M, 0.9 * TOLERANCE_M)
"""What Doppler does not predict, reflections, noise."""


@given(whole=st.integers(-20, 20), others_m=st.lists(OTHER_M, min_size=2, max_size=20))
def test_whole_milliseconds_common_to_all_are_found(whole: int, others_m: list[float]) -> None:
    assert clock_jump_ms([whole * MILLISECOND_M + other for other in others_m]) == whole


@given(others_m=st.lists(st.floats(-100_000.0, 100_000.0), max_size=20))
def test_what_is_below_a_millisecond_is_no_jump(others_m: list[float]) -> None:
    assert clock_jump_ms(others_m) == 0


def test_one_satellite_proves_nothing() -> None:
    assert clock_jump_ms([MILLISECOND_M]) == 0
    assert clock_jump_ms([MILLISECOND_M, 0.0, 0.0, 1.0]) == 0


def test_a_majority_is_enough() -> None:
    assert clock_jump_ms([MILLISECOND_M, MILLISECOND_M + 3.0, 0.4 * MILLISECOND_M]) == 1


def test_a_change_between_milliseconds_is_no_jump() -> None:
    assert clock_jump_ms([1.4 * MILLISECOND_M] * 6) == 0
