"""What is said where a bound spans two passages of the same ground."""

from __future__ import annotations

import math

import numpy as np
import pytest

from services.gnss_correction.line_passages import undecided
from tests.unit.gnss_correction.made_up_line import axis_through, bend, there_and_back

LOOP = there_and_back()
"""Its first 300 m run east, 4 m beside a later stretch that runs west."""


TWICE_ROUND = np.radians(np.arange(0.0, 700.0, 3.0))


@pytest.mark.parametrize("bound_m", [math.nan, 20.0, 190.0])
def test_a_bound_that_spans_no_other_passage_says_nothing(bound_m: float) -> None:
    assert undecided(LOOP, 100.0, bound_m) == ""


def test_passages_against_each_other_leave_the_direction_open() -> None:
    words = "direction not known yet: the line passes here 2 times, the bound covers all of them"
    assert undecided(LOOP, 100.0, LOOP.length_m) == words


def test_passages_alike_leave_the_passage_open() -> None:
    circle = axis_through(100.0 * np.cos(TWICE_ROUND), 100.0 * np.sin(TWICE_ROUND))
    assert undecided(circle, 20.0, 700.0).startswith("passage not known yet: the line passes here 2 times")


def test_a_large_bound_alone_is_no_other_passage() -> None:
    assert undecided(bend(), 100.0, 3_000.0) == ""


def test_a_passage_beyond_the_bound_is_not_meant() -> None:
    assert undecided(LOOP, 20.0, 200.0) == ""
