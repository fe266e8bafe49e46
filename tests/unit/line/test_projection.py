"""Projection: a place on the axis is found again, and a line near itself is not confused with itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.line.axis import Axis, axis_of
from services.line.projection import Foot, candidates, follow

METRES_PER_DEGREE = 111_319.5


def hairpin(gap_m: float = 6.0) -> Axis:
    """1 km to the east and back, `gap_m` further north."""
    east = np.concatenate([np.linspace(0, 1000, 101), np.linspace(1000, 0, 101)])
    north = np.concatenate([np.zeros(101), np.full(101, gap_m)])
    return axis_of(north / 110_574.3, east / METRES_PER_DEGREE, np.zeros(202))


HAIRPIN = hairpin()


def project(axis: Axis, place: np.ndarray) -> Foot:
    return candidates(axis, place, 1e4)[0]


def at(axis: Axis, axis_m: float) -> np.ndarray:
    return np.array([np.interp(axis_m, axis.axis_m, axis.plane_m[:, k]) for k in range(2)])


@given(st.floats(0.0, HAIRPIN.length_m))
def test_a_place_on_the_axis_comes_back_within_its_window(axis_m: float) -> None:
    feet = follow(HAIRPIN, at(HAIRPIN, axis_m)[None], np.array([50.0]), start_m=axis_m)
    # Interpolation in the plane against lengths in space: 1 km away that is below a millimetre.
    assert feet[0, 0] == pytest.approx(axis_m, abs=1e-3)
    assert abs(feet[0, 1]) < 1e-6


def test_side_is_positive_to_the_left() -> None:
    foot = project(HAIRPIN, np.array([500.0, -3.0]))
    assert foot.axis_m == pytest.approx(500.0, abs=0.01)
    assert foot.aside_m == pytest.approx(-3.0, abs=0.01)
    assert project(HAIRPIN, np.array([500.0, 8.0])).aside_m == pytest.approx(-2.0, abs=0.01)


def test_a_run_keeps_to_its_passage_where_the_other_is_nearer() -> None:
    # All places lie 4 m north of the way out, 2 m from the way back: nearest alone would jump.
    places = np.stack([np.arange(100.0, 900.0, 10.0), np.full(80, 4.0)], axis=1)
    feet = follow(HAIRPIN, places, np.full(80, 50.0), start_m=100.0)
    assert np.allclose(feet[:, 0], places[:, 0], atol=0.01)
    assert project(HAIRPIN, places[0]).axis_m > 1000.0


def test_places_that_are_none_have_no_foot_and_do_not_lose_the_way() -> None:
    places = np.array([[100.0, 4.0], [np.nan, np.nan], [110.0, 4.0]])
    feet = follow(HAIRPIN, places, np.full(3, 50.0), start_m=100.0)
    assert np.isnan(feet[1]).all()
    assert feet[2, 0] == pytest.approx(110.0, abs=0.01)


def test_every_passage_is_a_candidate_nearest_first() -> None:
    feet = candidates(HAIRPIN, np.array([300.0, 1.0]), 20.0)
    assert [round(foot.axis_m) for foot in feet] == [300, 1706]
    assert len(candidates(HAIRPIN, np.array([300.0, 1.0]), 3.0)) == 1
    assert candidates(HAIRPIN, np.array([300.0, 400.0]), 20.0) == ()
