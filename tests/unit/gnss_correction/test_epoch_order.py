"""Which epochs may be solved."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.gnss_correction.epoch_order import RESTART_EPOCHS, EpochOrder

WEEK = 2_300


def refusals(*tows_s: float) -> list[str]:
    order = EpochOrder()
    return [order.refusal(WEEK, tow_s) for tow_s in tows_s]


def test_rising_epochs_are_fine() -> None:
    assert refusals(1.0, 1.2, 1.4, 500.0) == ["", "", "", ""]


def test_a_new_week_goes_on() -> None:
    order = EpochOrder()
    assert order.refusal(WEEK, 604_799.8) == ""
    assert order.refusal(WEEK + 1, 0.0) == ""


def test_repeated_and_late_epochs_are_refused() -> None:
    assert refusals(1.0, 1.0, 0.6, 1.2) == ["", "epoch repeated", "epoch steps back by 0.400 s", ""]


def test_a_lasting_step_back_is_believed() -> None:
    order = EpochOrder()
    assert order.refusal(WEEK, 5_000.0) == ""
    later = [order.refusal(WEEK, 100.0 + 0.2 * k) for k in range(RESTART_EPOCHS + 3)]
    assert [bool(one) for one in later] == [True] * (RESTART_EPOCHS - 1) + [False] * 4
    assert order.restarts == 1


def test_scattered_late_epochs_are_not() -> None:
    order = EpochOrder()
    for k in range(40):
        assert order.refusal(WEEK, 100.0 + k) == ""
        assert order.refusal(WEEK, 50.0 + k) != ""
    assert order.restarts == 0


@pytest.mark.parametrize("week", [WEEK, -1, 10_000])
@pytest.mark.parametrize("tow_s", [math.nan, math.inf, -0.2, 604_800.0, 3.0])
def test_absurd_times_are_refused_and_leave_no_trace(week: int, tow_s: float) -> None:
    if week == WEEK and tow_s == 3.0:
        return
    order = EpochOrder()
    assert order.refusal(week, tow_s).startswith("absurd epoch time")
    assert order.refusal(WEEK, 1.0) == ""


@given(tows_s=st.lists(st.integers(0, 30), max_size=60))
def test_what_is_accepted_rises_between_restarts(tows_s: list[int]) -> None:
    order, accepted, restarts = EpochOrder(), [-1], 0
    for tow_s in tows_s:
        if order.refusal(WEEK, float(tow_s)):
            continue
        if order.restarts > restarts:
            restarts = order.restarts
        else:
            assert tow_s > accepted[-1]
        accepted.append(tow_s)
