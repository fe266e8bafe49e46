"""Kilometrage: there and back, broken chains, and what is none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.line.chainage import ChainageError, chainage_of

BROKEN = chainage_of([0.0, 1000.0, 1000.0, 3000.0], [12_000.0, 13_010.0, 12_800.0, 14_800.0])
"""At 1000 m the chainage falls back by 210 m, so that 12.8 to 13.01 km occur twice."""
FALLING = chainage_of([0.0, 500.0, 2000.0], [9_000.0, 8_490.0, 7_000.0])


@given(st.floats(0.0, 3000.0))
def test_every_place_is_among_those_of_its_chainage(axis_m: float) -> None:
    places = BROKEN.places(float(BROKEN.at(axis_m)))
    assert min(abs(place - axis_m) for place in places) < 1e-6


@given(st.floats(7_000.0, 9_000.0))
def test_a_falling_chainage_goes_there_and_back(chainage_m: float) -> None:
    (place,) = FALLING.places(chainage_m)
    assert float(FALLING.at(place)) == pytest.approx(chainage_m, abs=1e-6)


def test_a_chainage_that_occurs_twice_has_two_places() -> None:
    assert BROKEN.places(12_900.0) == pytest.approx((900.0 / 1.01, 1100.0))
    assert BROKEN.places(20_000.0) == ()


def test_at_the_break_the_next_piece_begins() -> None:
    assert float(BROKEN.at(1000.0)) == 12_800.0
    assert float(BROKEN.at(999.0)) == pytest.approx(13_010.0 - 1.01)


def test_beyond_the_ends_it_goes_on_metre_by_metre() -> None:
    assert BROKEN.at([-10.0, 3010.0]).tolist() == [11_990.0, 14_810.0]
    assert FALLING.at([-10.0, 2010.0]).tolist() == [9_010.0, 6_990.0]


def test_a_bound_across_a_break_covers_both_sides() -> None:
    assert BROKEN.reach_m(500.0, 10.0) == pytest.approx(10.1)
    # 5 m before the break the chainage is 13 004.95; just beyond it is 12 800.
    assert BROKEN.reach_m(995.0, 10.0) == pytest.approx(204.95)


@pytest.mark.parametrize(
    ("axis", "given_m", "words"),
    [
        ([0.0], [0.0], "two places"),
        ([0.0, 5.0, 3.0], [0.0, 5.0, 6.0], "place 3: axis_m 3 after 5"),
        ([0.0, 5.0], [1.0, 1.0], "stands still"),
        ([0.0, 5.0, 5.0, 5.0, 9.0], [0.0, 5.0, 6.0, 7.0, 9.0], "more than two"),
        ([0.0, 0.0, 5.0], [0.0, 1.0, 5.0], "at the end"),
        ([0.0, np.nan], [0.0, 1.0], "no number"),
        ([0.0, 5.0], [0.0, 1e300], "place 2: chainage 1e\\+300 m is none"),
    ],
)
def test_what_is_no_kilometrage_is_refused(axis: list[float], given_m: list[float], words: str) -> None:
    with pytest.raises(ChainageError, match=words):
        chainage_of(axis, given_m)
