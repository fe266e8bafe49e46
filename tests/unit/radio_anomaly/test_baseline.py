from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.radio_anomaly.baseline import Baseline, Book, Sums, one
from services.radio_anomaly.stream_state import StreamState


def book_of(values: list[tuple[str, str, int, str, float]]) -> Book:
    book = Book()
    for day, direction, section, cell, value in values:
        book.add(day, (direction, section, cell), one(value))
    return book


def test_a_section_with_many_passes_decides_alone() -> None:
    generator = np.random.default_rng(1)
    values = generator.normal(-80.0, 2.0, 2000)
    baseline = Baseline("power", {("up", 5, "c"): Sums(2000.0, float(values.sum()), float((values**2).sum()))})
    found = baseline.predict("up", 5, "c")
    # The line's own mean weighs 4 dB² / (16 · 9 dB² · 2000) here.
    assert found.mean == pytest.approx(values.mean(), abs=1e-3)
    assert found.variance == pytest.approx(4.0, rel=0.1)
    assert found.mean_variance == pytest.approx(found.variance / 2000.0, rel=0.01)


def test_an_unknown_cell_is_far_less_sure() -> None:
    groups = {("up", s, "a"): Sums(10.0, -800.0, 64_010.0) for s in range(10)}
    baseline = Baseline("power", groups)
    known, unknown = baseline.predict("up", 5, "a"), baseline.predict("up", 5, "b")
    assert unknown.mean_variance > 20.0 * known.mean_variance
    assert unknown.mean == pytest.approx(-80.0)


def test_the_other_direction_helps_where_this_one_was_never_driven() -> None:
    groups = {("down", s, "a"): Sums(10.0, -800.0 - 10.0 * s, 10.0 * (80.0 + s) ** 2 + 10.0) for s in range(10)}
    found = Baseline("power", groups).predict("up", 7, "a")
    assert found.mean == pytest.approx(-87.0, abs=0.6), "its neighbours -84 to -89 and the line's -84.5 weigh little"
    assert 1.0 < found.mean_variance < 9.0


def test_nothing_learned_is_as_wide_as_the_line() -> None:
    found = Baseline("power", {("up", 5, ""): Sums(4.0, -320.0, 25_604.0)}).predict("up", 500, "")
    assert found.passes == 0.0
    assert found.mean_variance == pytest.approx(16.0 * 9.0)


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["2026-01-05", "2026-01-06", "2026-01-09"]),
            st.sampled_from(["up", "down"]),
            st.integers(0, 5),
            st.sampled_from(["a", "b"]),
            st.floats(-110.0, -50.0),
        ),
        min_size=1,
        max_size=40,
    ),
    st.integers(0, 40),
)
def test_sums_merge_in_any_split(values: list[tuple[str, str, int, str, float]], cut: int) -> None:
    whole = book_of(values).merged(60.0, None)
    first, second = book_of(values[:cut]), book_of(values[cut:])
    for group, days in second.learned.items():
        for day, sums in days.items():
            first.add(day, group, sums)
    parts = first.merged(60.0, None)
    assert parts.keys() == whole.keys()
    for group, sums in whole.items():
        # Only the order of additions differs.
        assert parts[group].n == pytest.approx(sums.n)
        assert parts[group].total == pytest.approx(sums.total, rel=1e-12)
        assert parts[group].squares == pytest.approx(sums.squares, rel=1e-12)


def test_old_days_are_forgotten_by_half_in_a_half_life() -> None:
    book = book_of([("2026-01-01", "up", 0, "", -80.0), ("2026-03-02", "up", 0, "", -90.0)])
    sums = book.merged(60.0, None)[("up", 0, "")]
    assert sums.n == pytest.approx(1.5)
    assert sums.mean == pytest.approx((-0.5 * 80.0 - 90.0) / 1.5)


def test_what_was_withheld_counts_only_where_it_is_accepted() -> None:
    book = book_of([("2026-01-01", "up", 0, "", -80.0)])
    book.add("2026-01-02", ("up", 0, ""), one(-90.0), withheld=True)
    assert book.merged(60.0, None)[("up", 0, "")].mean == -80.0
    accepted = book.merged(60.0, lambda _d, _s, day: "accepted" if day >= "2026-01-02" else None)
    assert accepted[("up", 0, "")].mean == -90.0


def test_a_site_and_the_line_know_nothing_of_each_other() -> None:
    state = StreamState()
    for section in range(3):
        state.books["power"].add("2026-01-05", ("up", section, ""), Sums(10.0, -600.0, 36_010.0))
    state.books["power"].add("2026-01-05", ("", 0, ""), Sums(10.0, -900.0, 81_010.0))
    # Each alone says -60 and -90 dBm; drawn together with the other they would lie between.
    assert state.baseline("power", 120.0, None).predict("up", 0, "").mean == pytest.approx(-60.0, abs=1e-9)
    assert state.baseline("power", 120.0, None, site=True).predict("", 0, "").mean == pytest.approx(-90.0, abs=1e-9)
