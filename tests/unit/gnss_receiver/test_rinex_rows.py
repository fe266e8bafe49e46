"""Fixed-width fields become exactly the numbers that their text says, or nothing."""

from __future__ import annotations

import math
import re

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from services.gnss_receiver.observations import Observations
from services.gnss_receiver.rinex_observations import parse_observations
from tests.unit.gnss_receiver.samples import header_3, text_of

TYPES = {"G": ("C1C", "L1C", "D1C", "S1C")}
STRICT = re.compile(r" *[+-]?\d*\.\d{3}")


def read_fields(fields: list[str]) -> Observations:
    """A file of one epoch with one field per satellite: a pseudorange."""
    lines = [f"> 2016 06 06 11 10 41.7000000  0{len(fields):3d}"]
    lines += [f"G{index + 1:02d}{text}" for index, text in enumerate(fields)]
    return parse_observations(text_of(header_3({"G": ("C1C",)}), lines), "fields.rnx")


def values_of(observations: Observations, count: int) -> list[float]:
    """One figure per satellite of `read_fields`, NaN where its row is missing."""
    found = dict(zip((observations.satellite % 100).tolist(), observations.pseudorange_m.tolist(), strict=True))
    return [found.get(index + 1, math.nan) for index in range(count)]


@st.composite
def f14_3(draw: st.DrawFn) -> str:
    """Anything that Fortran's F14.3 can print, with and without a leading zero or a sign."""
    milli = draw(st.integers(-(10**12) + 1, 10**13 - 1) | st.integers(-2000, 2000))
    whole, rest = divmod(abs(milli), 1000)
    sign = "-" if milli < 0 else ""
    bare = draw(st.booleans()) and whole == 0
    return f"{sign}{'' if bare else whole}.{rest:03d}".rjust(14)


@given(st.lists(f14_3(), min_size=1, max_size=60))
def test_fields_equal_their_text_exactly(fields: list[str]) -> None:
    observations = read_fields(fields)
    assert observations.issues == ()
    for text, value in zip(fields, values_of(observations, len(fields)), strict=True):
        # Zero stands for a missing measurement in RINEX.
        assert value == float(text) or (math.isnan(value) and float(text) == 0.0)


@given(st.lists(st.text(" 0123456789.-+ED*x", min_size=14, max_size=14), min_size=1, max_size=60))
def test_what_is_no_f14_3_is_refused_and_named(fields: list[str]) -> None:
    observations = read_fields(fields)
    complaints = {issue.line for issue in observations.issues}
    first_line = len(header_3({"G": ("C1C",)})) + 2
    for index, (text, value) in enumerate(zip(fields, values_of(observations, len(fields)), strict=True)):
        good = STRICT.fullmatch(text) is not None
        if good and float(text) != 0.0:
            assert value == float(text)
        else:
            assert math.isnan(value)
        assert ((first_line + index) in complaints) == (not good and bool(text.strip()))


def test_a_cut_field_is_refused_and_a_missing_one_is_not() -> None:
    whole = "  20000000.123"
    for length in range(1, 14):
        observations = read_fields([whole[:length]])
        refused = bool(whole[:length].strip())
        assert [issue.line for issue in observations.issues] == ([6] if refused else [])
        assert len(observations.satellite) == 0
    assert values_of(read_fields([whole]), 1) == [20000000.123]


def test_a_shifted_line_is_refused_whole() -> None:
    fields = "".join(f"{value:14.3f}  " for value in (20000000.123, 105000000.5, 40.0, -2000.25))
    for shift in range(1, 12):
        line = f"G01{' ' * shift}{fields}".rstrip()
        content = text_of(header_3(TYPES), ["> 2016 06 06 11 10 41.7000000  0  1", line])
        observations = parse_observations(content, "shifted.rnx")
        assert observations.issues
        assert len(observations.satellite) == 0


def test_loss_of_lock_is_read_with_the_phase_and_without() -> None:
    lines = [
        "> 2016 06 06 11 10 41.7000000  0  3",
        "G01" + "  20000000.123 7" + " 105000000.50017" + "       -10.000  " + "        40.000  ",
        "G02" + "  20000000.123  " + " " * 14 + "4 " + "       -10.000  ",
        "G03" + "  20000000.123  " + " 105000000.5009 " + "       -10.000",
    ]
    observations = parse_observations(text_of(header_3(TYPES), lines), "lock.rnx")
    assert observations.issues == ()
    assert observations.lock_lost.tolist() == [1, 4, 0]
    assert np.isnan(observations.carrier_phase_cycles).tolist() == [False, True, False]


def test_an_indicator_that_is_no_digit_refuses_its_field() -> None:
    lines = ["> 2016 06 06 11 10 41.7000000  0  1", "G01  20000000.123x  105000000.500"]
    observations = parse_observations(text_of(header_3(TYPES), lines), "x.rnx")
    assert [issue.text for issue in observations.issues] == [
        "pseudorange of G01 on 1C is left out, it cannot be read: '  20000000.123x '"
    ]
    assert np.isnan(observations.pseudorange_m).tolist() == [True]
    assert observations.carrier_phase_cycles.tolist() == [105000000.5]


def test_scale_factors_divide() -> None:
    header = header_3(TYPES)
    header.insert(-1, f"{'G   10   2 C1C D1C':60}SYS / SCALE FACTOR")
    lines = [
        "> 2016 06 06 11 10 41.7000000  0  1",
        "G01" + " 200000001.230  " + " 105000000.500  " + "       -20.000  " + "        40.000",
    ]
    observations = parse_observations(text_of(header, lines), "scaled.rnx")
    assert observations.issues == ()
    assert observations.pseudorange_m.tolist() == [20000000.123]
    assert observations.carrier_phase_cycles.tolist() == [105000000.5]
    assert observations.doppler_hz.tolist() == [-2.0]
    assert observations.cn0_dbhz.tolist() == [40.0]
