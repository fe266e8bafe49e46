"""The choice of an ephemeris."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.gnss import Ephemeris
from services.gnss_correction.ephemeris_store import MOST_PER_SATELLITE, EphemerisStore
from services.gnss_correction.ephemeris_table import (
    NO_EPHEMERIS,
    STALE,
    UNHEALTHY,
    EphemerisTable,
    select,
    selection_reason,
    tabulate,
)
from services.gnss_receiver.observations import satellite_code
from tests.unit.gnss_correction.made_up_sky import START_S, WEEK, ephemeris


def chosen(table: EphemerisTable, satellite: str, t_s: float) -> int:
    return int(select(table, np.array([satellite_code(satellite)]), np.array([t_s]))[0])


def issue_chosen(ephemerides: list[Ephemeris], t_s: float) -> float:
    """Clock bias of the chosen one, which the tests use as its name."""
    table = tabulate(ephemerides, WEEK)
    return float(table.rows["clock_bias_s"][chosen(table, "G05", t_s)])


def test_the_nearest_reference_time_wins() -> None:
    early = ephemeris("G05", toe_s=START_S, clock_bias_s=1.0)
    late = ephemeris("G05", toe_s=START_S + 7_200.0, clock_bias_s=2.0)
    for order in ([early, late], [late, early]):
        assert issue_chosen(order, START_S + 3_599.0) == 1.0
        assert issue_chosen(order, START_S + 3_601.0) == 2.0
        assert issue_chosen(order, START_S + 3_600.0) == 2.0, "of two equally near the later one"


def test_of_two_with_the_same_reference_time_the_one_sent_last_wins() -> None:
    first = ephemeris("G05", t_ns=1, issue=9, clock_bias_s=1.0)
    second = ephemeris("G05", t_ns=2, issue=3, clock_bias_s=2.0)
    assert issue_chosen([second, first], START_S) == 2.0


@pytest.mark.parametrize(
    ("changes", "t_s", "code", "words"),
    [
        ({}, START_S + 7_200.0, 0, ""),
        ({}, START_S + 7_230.0, STALE, "ephemeris stale by 30 s"),
        ({}, START_S - 8_200.0, STALE, "ephemeris stale by 1000 s"),
        ({"healthy": False}, START_S, UNHEALTHY, "unhealthy"),
        ({"fit_interval_s": float("nan")}, START_S, STALE, "ephemeris stale by nan s"),
    ],
)
def test_it_says_why_there_is_none(changes: dict[str, Any], t_s: float, code: int, words: str) -> None:
    table = tabulate([ephemeris("G05", **changes)], WEEK)
    assert chosen(table, "G05", t_s) == code
    assert selection_reason(table, satellite_code("G05"), t_s, code) == words


def test_a_satellite_that_was_never_heard_has_none() -> None:
    table = tabulate([ephemeris("G05")])
    assert chosen(table, "G06", START_S) == NO_EPHEMERIS
    assert chosen(tabulate([]), "C63", 0.0) == NO_EPHEMERIS
    assert selection_reason(table, satellite_code("G06"), START_S, NO_EPHEMERIS) == "no ephemeris"


def test_an_unhealthy_ephemeris_is_not_evaded_by_an_older_healthy_one() -> None:
    older = ephemeris("G05", toe_s=START_S - 7_200.0)
    newer = ephemeris("G05", toe_s=START_S, healthy=False)
    assert chosen(tabulate([older, newer], WEEK), "G05", START_S - 100.0) == UNHEALTHY


def test_weeks_are_counted_through() -> None:
    table = tabulate([ephemeris("G05", gps_week=WEEK + 1, toe_s=0.0)], WEEK)
    assert chosen(table, "G05", 604_800.0 - 60.0) == 0
    assert table.seconds(WEEK + 1, 5.0) == 604_805.0


@given(
    toes=st.lists(st.integers(0, 20), min_size=1, max_size=8),
    t_s=st.integers(-5, 25),
    fit_s=st.integers(0, 6),
)
@settings(max_examples=60)
def test_it_agrees_with_a_plain_search(toes: list[int], t_s: int, fit_s: int) -> None:
    table = tabulate([ephemeris("G05", toe_s=float(toe), fit_interval_s=float(fit_s)) for toe in toes], WEEK)
    row = chosen(table, "G05", float(t_s))
    nearest = min(abs(t_s - toe) for toe in toes)
    if nearest > fit_s:
        assert row == STALE
    else:
        assert abs(table.rows["toe_s"][row] - t_s) == nearest


def test_the_store_keeps_what_was_heard_last_and_forgets_the_oldest() -> None:
    store = EphemerisStore()
    for step in range(MOST_PER_SATELLITE + 5):
        store.add(ephemeris("R01", toe_s=float(step)))
    table = store.table()
    assert table.rows["toe_s"].tolist() == [float(step) for step in range(5, MOST_PER_SATELLITE + 5)]
    assert store.table() is table, "nothing new, no new table"
    store.add(ephemeris("R01", toe_s=5.0, healthy=False))
    assert store.table().rows["healthy"].tolist().count(0) == 1
