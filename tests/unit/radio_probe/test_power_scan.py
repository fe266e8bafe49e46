from __future__ import annotations

from math import isfinite

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.radio_probe.power_scan import ScanSums, scan_line
from services.radio_probe.settings import Band

LOW, HIGH = 2.4e9, 2.41e9
BAND = Band(channel="ch1", low_hz=LOW, high_hz=HIGH)


def line(time: str, low_hz: float, high_hz: float, step_hz: float, *powers: object) -> str:
    return f"2026-10-26, {time}, {low_hz:.0f}, {high_hz:.0f}, {step_hz:.2f}, 16, {', '.join(map(str, powers))}"


def test_bins_are_where_the_line_says() -> None:
    found = scan_line(line("07:00:00", LOW, HIGH, 2.5e6, -50, -51, -52, -53, -53))
    assert found is not None
    # The last power is written twice by rtl_power.
    assert (found.low_hz, found.step_hz, found.powers_db) == (LOW, 2.5e6, (-50.0, -51.0, -52.0, -53.0))


def test_a_channel_is_the_sum_of_its_bins_over_all_lines_of_a_sweep() -> None:
    sums = ScanSums((BAND,))
    middle = (LOW + HIGH) / 2
    for time in ("07:00:00", "07:00:10"):
        assert sums.feed(line(time, LOW, middle, 2.5e6, -60, -60)) == [] or time.endswith("10")
        assert sums.feed(line(time, middle, HIGH, 2.5e6, -60, -60)) == []
    (last,) = sums.end()
    # Four equal bins: 10 log10(4) = 6.02 dB more.
    assert last.power_db == pytest.approx(-53.979, abs=1e-3)
    assert last.t_ns == 1_792_998_010 * 10**9
    assert sums.counts["sweeps"] == 2


def test_only_bins_inside_count() -> None:
    sums = ScanSums(
        (Band(channel="a", low_hz=LOW + 2.5e6, high_hz=LOW + 5e6), Band(channel="b", low_hz=1.0, high_hz=2.0))
    )
    sums.feed(line("07:00:00", LOW, HIGH, 2.5e6, -10, -60, -20, "nan"))
    assert [(one.channel, round(one.power_db, 6)) for one in sums.end()] == [("a", -60.0)]
    assert sums.end() == []


@given(st.text(max_size=400))
def test_garbage_is_no_scan_and_no_crash(text: str) -> None:
    sums = ScanSums((BAND,))
    sums.feed(text)
    sums.feed(f"2026-10-26, 07:00:00, {text}")
    for one in sums.end():
        assert isfinite(one.power_db)


@given(st.lists(st.floats(), min_size=3, max_size=3), st.lists(st.floats(), min_size=1, max_size=8))
def test_any_numbers_are_borne(head: list[float], powers: list[float]) -> None:
    sums = ScanSums((Band(channel="all", low_hz=1e-3, high_hz=1e15),))
    cells = [*map(repr, head), "1", *map(repr, powers)]
    sums.feed(f"2026-10-26, 07:00:00, {', '.join(cells)}")
    assert all(isfinite(one.power_db) for one in sums.end())
