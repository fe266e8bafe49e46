"""Pieces of a map become one line, however they come."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.line.smoothing import lengths_m
from services.line.stitching import StitchingError, stitch

BEND = np.stack([np.arange(0.0, 5001.0, 50.0), 300.0 * np.sin(np.arange(0.0, 5001.0, 50.0) / 800.0)], axis=1)


def pieces(line: np.ndarray, cuts: list[int]) -> list[np.ndarray]:
    edges = [0, *sorted(set(cuts)), len(line) - 1]
    return [line[a : b + 1] for a, b in pairwise(edges)]


def same_way(found: np.ndarray, wanted: np.ndarray) -> bool:
    return found.shape == wanted.shape and (np.allclose(found, wanted) or np.allclose(found[::-1], wanted))


@settings(max_examples=40)
@given(st.lists(st.integers(1, len(BEND) - 2), max_size=12), st.randoms(use_true_random=False))
def test_order_and_sense_of_the_pieces_do_not_matter(cuts: list[int], random: object) -> None:
    lines = [one[::-1] if random.random() < 0.5 else one for one in pieces(BEND, cuts)]  # type: ignore[attr-defined] # hypothesis gives random.Random
    random.shuffle(lines)  # type: ignore[attr-defined] # the same
    doubled = [*lines, lines[0], lines[-1][::-1]]
    stitched = stitch(doubled)
    assert same_way(stitched.main_m, BEND)
    assert (stitched.branches, stitched.parallel, stitched.notes) == ((), (), ())


def test_small_gaps_are_closed_and_said() -> None:
    first, second = BEND[:40], BEND[40:]
    stitched = stitch([second, first])
    assert same_way(stitched.main_m, BEND)
    assert stitched.notes == ("a gap of 52 m was closed by a straight",)


def test_wide_gaps_are_not_closed() -> None:
    stitched = stitch([BEND[:40], BEND[60:]])
    assert same_way(stitched.main_m, BEND[60:]) or same_way(stitched.main_m, BEND[:40])
    assert "hang together with nothing" in stitched.notes[0]


def test_a_line_that_leaves_is_a_branch() -> None:
    out = BEND[30] + np.stack([np.arange(0.0, 1500.0, 50.0), -0.02 * np.arange(0.0, 1500.0, 50.0) ** 1.3], axis=1)
    stitched = stitch([out[::-1], BEND])
    assert same_way(stitched.main_m, BEND)
    assert len(stitched.branches) == 1
    assert stitched.branches[0].plane_m == pytest.approx(out)


def test_a_short_spur_is_none() -> None:
    spur = BEND[30] + np.array([[0.0, 0.0], [100.0, -20.0], [200.0, -50.0]])
    stitched = stitch([BEND, spur])
    assert stitched.branches == ()
    assert "neither main line nor branch" in stitched.notes[0]


def test_the_other_track_of_a_double_line_is_parallel() -> None:
    beside = BEND[5:60] + np.array([0.0, 4.0])
    for lines in ([BEND, beside], [BEND, np.concatenate([BEND[4:5], beside, BEND[61:62]])]):
        stitched = stitch(lines)
        assert lengths_m(stitched.main_m)[-1] == pytest.approx(lengths_m(BEND)[-1], rel=0.01)
        assert len(stitched.parallel) == 1
        assert stitched.branches == ()


def test_a_train_does_not_turn_round_at_a_joint() -> None:
    back = BEND[-1] + np.array([[0.0, 0.0], [-400.0, 60.0], [-1500.0, 500.0]])
    assert lengths_m(stitch([BEND, back]).main_m)[-1] == pytest.approx(lengths_m(BEND)[-1])
    both = stitch([BEND, back], reversals=True)
    assert lengths_m(both.main_m)[-1] == pytest.approx(lengths_m(BEND)[-1] + lengths_m(back)[-1])


def test_nothing_and_far_too_much_are_refused() -> None:
    with pytest.raises(StitchingError, match="no line with a length"):
        stitch([np.zeros((3, 2))])
    with pytest.raises(StitchingError, match="select one line"):
        stitch([BEND[:2]] * 20_001)
