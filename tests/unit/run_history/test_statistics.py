"""Groups, histogram, margin and patterns on figures that can be worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.run_history.patterns import patterns_of
from services.run_history.run_statistics import OUTSIDE_HOURS, Selection, groups_of, histogram
from services.run_history.saving_margin import saving_margin
from tests.unit.run_history.run_examples import NOON_S, row

ALL_DAY = Selection(0.0, 24.0)


def test_departures_count_by_local_hours_also_over_midnight() -> None:
    assert Selection().holds(NOON_S)
    assert not Selection(zone="UTC").holds(NOON_S)  # 3 o'clock there
    assert Selection().holds(NOON_S - 2 * 3600.0)
    assert not Selection().holds(NOON_S + 4 * 3600.0)
    night = Selection(22.0, 5.0)
    assert night.holds(NOON_S + 11 * 3600.0)
    assert night.holds(NOON_S - 8 * 3600.0)
    assert not night.holds(NOON_S)


def test_groups_part_sections_directions_and_series_and_say_what_is_left_out() -> None:
    rows = [
        row(1, 420.0, 50.0),
        row(2, 421.0, 40.0),
        row(2, 421.0, 40.0),
        row(3, 430.0, 45.0, series="6000"),
        row(4, 430.0, 45.0, excluded_because="a gap of 17 s; held between stations"),
        row(5, 430.0, 45.0, excluded_because="a gap of 31.5 s"),
        row(6, 430.0, 45.0, departure_s=NOON_S + 8 * 3600.0),
        row(7, 430.0, 45.0, start="Toyonaka", end="Juso", direction="up"),
    ]
    groups = groups_of(rows, Selection())
    assert [(one.direction, one.series, len(one.rows)) for one in groups] == [
        ("down", "1000", 2),
        ("down", "6000", 1),
        ("up", "1000", 1),
    ]
    assert dict(groups[0].left_out) == {"a gap": 2, "there twice": 1, OUTSIDE_HOURS: 1}
    assert groups[0].energies.tolist() == pytest.approx([50.0 / 45.0, 40.0 / 45.0])
    assert groups[0].small


@given(st.lists(st.floats(100.0, 900.0), min_size=1, max_size=60))
def test_every_time_stands_in_the_bar_that_holds_it(times: list[float]) -> None:
    bars = histogram(np.array(times))
    assert bars.counts.sum() == len(times)
    assert np.diff(bars.edges_s).tolist() == [10.0] * len(bars.counts)
    assert bars.edges_s[0] <= min(times) < bars.edges_s[0] + 10.0
    assert bars.edges_s[-1] - 10.0 <= max(times) < bars.edges_s[-1]


def test_no_times_make_no_bars() -> None:
    assert len(histogram(np.zeros(0)).counts) == 0


def test_the_margin_is_that_of_the_article_within_ten_seconds() -> None:
    rows = [row(1, 411.0, 60.0), row(2, 420.0, 50.0), row(3, 430.0, 40.0), row(4, 431.0, 10.0)]
    found = saving_margin(groups_of(rows, ALL_DAY)[0])
    assert found is not None
    assert found.reference == "scheduled"
    assert len(found.rows) == 3
    # Of 60, 50 and 40 the mean is 50 and the least 40; over the mean of all four, 40, that is 1.25 and 1.
    assert (found.mean, found.minimum) == pytest.approx((1.25, 1.0))
    assert found.margin == pytest.approx(0.2)
    assert found.best.run_id == "run3"
    assert found.small
    assert 0.0 <= found.low <= found.margin <= found.high


def test_without_a_schedule_the_median_stands_in_and_is_named() -> None:
    rows = [row(k, 400.0 + 5 * k, 50.0 - k, scheduled_s=None) for k in range(11)]
    found = saving_margin(groups_of(rows, ALL_DAY)[0])
    assert found is not None
    assert (found.reference, found.reference_s) == ("median", 425.0)
    assert len(found.rows) == 5
    assert found.small


def test_no_run_near_the_schedule_gives_no_margin() -> None:
    assert saving_margin(groups_of([row(1, 500.0, 50.0)], ALL_DAY)[0]) is None
    left_out = groups_of([row(1, 420.0, 50.0, excluded_because="held")], ALL_DAY)
    assert saving_margin(left_out[0]) is None


@given(st.lists(st.floats(20.0, 80.0), min_size=1, max_size=30), st.floats(0.5, 20.0))
def test_the_margin_knows_no_unit_of_energy(energies: list[float], factor: float) -> None:
    rows = [row(k, 420.0, energy) for k, energy in enumerate(energies)]
    scaled = [replace(one, energy_kwh=one.energy_kwh * factor) for one in rows]
    plain, other = (saving_margin(groups_of(some, ALL_DAY)[0]) for some in (rows, scaled))
    assert plain is not None
    assert other is not None
    # Both are the same arithmetic but for rounding.
    assert other.margin == pytest.approx(plain.margin, abs=1e-9)
    assert (other.low, other.high) == pytest.approx((plain.low, plain.high), abs=1e-9)
    assert plain == saving_margin(groups_of(rows, ALL_DAY)[0])


def test_the_interval_narrows_with_more_runs() -> None:
    draw = np.random.default_rng(1)

    def width(count: int) -> float:
        rows = [row(k, 420.0, float(energy)) for k, energy in enumerate(draw.normal(50.0, 3.0, count))]
        found = saving_margin(groups_of(rows, ALL_DAY)[0])
        assert found is not None
        return (found.high - found.low) / found.margin

    assert width(200) < width(12)


def test_the_five_patterns_are_those_of_the_article() -> None:
    rows = [
        row(1, 420.4, 50.0),
        row(2, 419.6, 60.0),
        row(3, 431.0, 45.0),
        row(4, 429.0, 46.0),
        row(5, 410.0, 55.0),
        row(6, 380.0, 90.0),
    ]
    found = {one.name: one.row.run_id if one.row else None for one in patterns_of(rows, 420.0)}
    assert found == {
        "on_time_saving": "run1",
        "on_time_wasteful": "run2",
        "slower_saving": "run3",
        "faster_saving": "run5",
        "fastest": "run6",
    }


def test_one_run_on_time_is_not_both_saving_and_wasteful() -> None:
    found = {one.name: one.row for one in patterns_of([row(1, 420.0, 50.0)], 420.0)}
    assert found["on_time_saving"] is not None
    assert found["on_time_wasteful"] is None
    assert found["slower_saving"] is None
