"""The refusal list, few cases each: `kirotei bench landmarks` runs a thousand."""

from __future__ import annotations

import pytest

from benchmarks.landmarks import CORRECT, MIXED, WRONG, moved, spread, table_row

CASES = 8
REASONS = {
    "curvature +25 %": {"upper limit", "curvature"},
    "opposite hand": {"sign"},
    "straight branch": {"no curve"},
    "length x 1.4": {"length"},
    "slip in the window": {"slip", "leap"},
    "speed below 10 km/h": {"low speed"},
    "twin within the window": {"twin"},
}
"""By what those are refused that can fail in one way only."""


@pytest.mark.parametrize("name", CORRECT)
def test_right_curves_are_accepted_within_their_bound(name: str) -> None:
    row = table_row(name, CORRECT[name], CASES, "")
    assert row.accepted >= CASES - 1, row.reasons  # 98 % over a thousand: one of eight may fail
    assert row.beyond_bound == 0


@pytest.mark.parametrize("name", WRONG)
def test_wrong_curves_are_refused(name: str) -> None:
    row = table_row(name, WRONG[name], CASES, "")
    assert row.accepted == 0
    if name in REASONS:
        assert set(row.reasons) <= REASONS[name] | {"start point"}
        assert sum(row.reasons.values()) == CASES


@pytest.mark.parametrize("name", MIXED)
def test_whatever_is_accepted_holds_its_bound(name: str) -> None:
    assert table_row(name, MIXED[name], CASES, "").beyond_bound == 0


def test_crossings_do_not_depend_on_speed_or_hand() -> None:
    found = spread(curves=6)
    assert found.median_m <= 1.5
    assert found.largest_m <= 2.5
    assert max(abs(error) for error in found.mean_error_m.values()) <= 1.0


def test_a_landmark_moved_by_works_does_not_stay_unnoticed() -> None:
    found = moved(6)
    assert found.unnoticed == 0
    assert found.refused + found.reported == 6
    assert found.false_reports == 0
