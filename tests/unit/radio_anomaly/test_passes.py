from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.radio_anomaly.held_places import placed_by_time
from services.radio_anomaly.passes import binned, day_of, plain, section_of, sorted_passes, transformed
from services.radio_anomaly.reading import Reading, refusal_of
from tests.unit.radio_anomaly.made_up import BEGIN_NS, DAY_NS, SETTINGS, at, one_pass


def test_passes_come_out_in_order_of_time_whatever_the_order_of_rows() -> None:
    rows = [one for number in (3, 0, 2, 1) for one in reversed(one_pass(number))]
    passes, left = sorted_passes(rows, SETTINGS)
    assert [one[0].pass_id for one in passes] == ["P000", "P001", "P002", "P003"]
    assert passes == sorted_passes(reversed(rows), SETTINGS)[0]
    assert sum(left.values()) == 0


def test_a_radio_that_reports_twice_counts_once() -> None:
    rows = one_pass(0)
    passes, left = sorted_passes([*rows, *rows], SETTINGS)
    assert len(passes[0]) == len(rows)
    assert left["reported twice"] == len(rows)


def test_a_place_that_jumps_is_left_out() -> None:
    rows = one_pass(0)
    rows[30] = at(rows[30], chainage_m=90_000.0)
    passes, left = sorted_passes(rows, SETTINGS)
    assert left["a place that jumps"] == 1
    assert max(one.chainage_m or 0.0 for one in passes[0]) < 5000.0


def test_a_clock_set_within_a_pass_is_left_out() -> None:
    rows = one_pass(0)
    rows[5] = at(rows[5], t_ns=rows[5].t_ns - 3 * DAY_NS)
    passes, left = sorted_passes(rows, SETTINGS)
    assert len(passes[0]) == len(rows) - 1
    assert left["a time half a day from its pass: the clock was set"] == 1


def test_bins_hold_the_mean_of_each_section() -> None:
    rows = [
        at(one_pass(0)[0], chainage_m=place, power_dbm=power)
        for place, power in ((10.0, -80.0), (60.0, -70.0), (140.0, -60.0), (150.0, -62.0), (230.0, -50.0))
    ]
    journey = binned([at(one, t_ns=one.t_ns + k) for k, one in enumerate(rows)], SETTINGS)
    assert [(one.section, one.count, one.value) for one in journey.bins] == [(0, 2, -75.0), (1, 2, -61.0)]
    assert journey.passed == (0, 1, 2), "the last section has a sample, though too few to count"


def test_sections_between_samples_were_passed_unless_the_train_stood() -> None:
    rows = one_pass(0, silent=range(10, 20))
    assert set(range(10, 20)) <= set(binned(rows, SETTINGS).passed)
    stood = [at(one, t_ns=one.t_ns + 7200 * 10**9) if (one.chainage_m or 0.0) > 1900.0 else one for one in rows]
    assert not set(range(10, 20)) & set(binned(stood, SETTINGS).passed)


def test_negative_kilometrage_has_sections_too() -> None:
    assert section_of(-0.1, 100.0) == -1
    assert section_of(-100.0, 100.0) == -1
    assert section_of(0.0, 100.0) == 0


@given(st.floats(0.0, 1.0))
def test_reception_is_transformed_there_and_back(ratio: float) -> None:
    # asin near 1 loses half of the digits.
    assert plain("reception", transformed("reception", ratio)) == pytest.approx(ratio, abs=1e-7)


@given(st.floats(0.0, 1e6))
def test_corrected_bits_are_transformed_there_and_back(bits: float) -> None:
    assert plain("bits", transformed("bits", bits)) == pytest.approx(bits, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"power_dbm": float("nan")}, "power_dbm"),
        ({"power_dbm": 900.0}, "power_dbm"),
        ({"t_ns": 315_964_800 * 10**9}, "reset"),
        ({"t_ns": 2_085_978_496 * 10**9}, "reset"),
        ({"chainage_m": 9e9}, "chainage_m"),
        ({"received_ratio": 1.2}, "received_ratio"),
        ({"power_dbm": None}, "neither"),
    ],
)
def test_what_cannot_be_is_refused_with_a_reason(changes: dict[str, object], word: str) -> None:
    assert word in (refusal_of(at(one_pass(0)[0], **changes)) or "")


def test_a_site_without_place_is_cut_into_periods() -> None:
    rows = [
        Reading(t_ns=BEGIN_NS + k * 60 * 10**9, pass_id="", radio="L", channel="c", power_dbm=-70.0) for k in range(25)
    ]
    passes, _ = sorted_passes(rows, SETTINGS)
    assert [len(one) for one in passes] == [10, 10, 5]
    assert binned(passes[1], SETTINGS).pass_id == "2026-01-05T08:10:00Z"
    assert day_of(BEGIN_NS) == "2026-01-05"


def held(every: int, *, speed_mps: float = 12.5) -> list[Reading]:
    """A pass at an even speed, a reading a second, whose place is told at every so many only."""
    rows = [at(one_pass(0)[0], t_ns=BEGIN_NS + k * 10**9, chainage_m=k * speed_mps) for k in range(160)]
    return [at(one, chainage_m=rows[k - k % every].chainage_m) for k, one in enumerate(rows)]


@given(st.integers(1, 20), st.floats(5.5, 90.0))
def test_a_place_that_is_repeated_goes_on_with_time(every: int, speed_mps: float) -> None:
    found = placed_by_time(held(every, speed_mps=speed_mps))
    last = (len(found) - 1) // every * every
    for k, one in enumerate(found[: last + 1]):
        # Of kilometres, in double precision.
        assert one.chainage_m == pytest.approx(k * speed_mps, abs=1e-6)
    assert {one.chainage_m for one in found[last:]} == {last * speed_mps}, "nobody knows where the train went on to"


def test_places_of_their_own_and_those_of_a_train_that_stood_stay() -> None:
    assert placed_by_time(held(1)) == held(1)
    crawling = held(8, speed_mps=2.0)
    assert placed_by_time(crawling) == crawling
    several = [at(one, radio=radio) for one in held(1) for radio in ("W1", "W2")]
    assert placed_by_time(several) == several, "radios measured at one time share a place"


def test_a_step_of_power_stays_where_it_is_when_places_are_held() -> None:
    def powers(every: int) -> dict[int, float]:
        rows = [at(one, power_dbm=-60.0 if k < 80 else -90.0) for k, one in enumerate(held(every))]
        return {one.section: one.value for one in binned(rows, SETTINGS).bins if one.quantity == "power"}

    # The last hold of a pass is left out: it has no next place.
    steady, jumping = powers(1), powers(9)
    assert {s: v for s, v in jumping.items() if s < 19} == pytest.approx({s: v for s, v in steady.items() if s < 19})
