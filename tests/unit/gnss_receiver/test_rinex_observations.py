"""Whole observation files, good ones: layouts, versions, signals, times."""

from __future__ import annotations

import math

import numpy as np
import pytest

from services.gnss_receiver.observations import satellite_name
from services.gnss_receiver.rinex_observations import parse_observations
from tests.unit.gnss_receiver.samples import (
    MANY,
    SATELLITES,
    TYPES_3,
    epoch_2,
    epoch_3,
    expected,
    header_2,
    header_3,
    header_line,
    rows_of,
    text_of,
    value_of,
)


@pytest.mark.parametrize("version", ["2.10", "2.11", "2.12", "2"])
def test_rinex_2(version: str) -> None:
    observations = parse_observations(
        text_of(header_2(version=version), *(epoch_2(index) for index in range(4))), "two.obs"
    )
    assert observations.issues == ()
    assert rows_of(observations) == expected(4)


@pytest.mark.parametrize("version", ["3.00", "3.01", "3.02", "3.03", "3.04", "3.05"])
def test_rinex_3(version: str) -> None:
    observations = parse_observations(
        text_of(header_3(version=version), *(epoch_3(index) for index in range(4))), "three.rnx"
    )
    assert observations.issues == ()
    assert rows_of(observations) == expected(4)


def test_more_satellites_than_a_rinex_2_list_line_holds() -> None:
    observations = parse_observations(text_of(header_2(), epoch_2(0, MANY), epoch_2(1, MANY)), "many.obs")
    assert observations.issues == ()
    assert rows_of(observations) == expected(2, MANY)


def test_more_observables_than_a_rinex_2_line_holds() -> None:
    types = ("C1", "L1", "S1", "D1", "P1", "X9", "P2", "L2", "S2", "D2", "C2")
    lines = epoch_2(0, SATELLITES, columns=len(types))
    assert len(lines) == 1 + 3 * len(SATELLITES)
    observations = parse_observations(text_of(header_2(types), lines), "wide.obs")
    assert [issue.text for issue in observations.issues] == ["observable 'X9' names no signal; its column is not read"]
    rows = rows_of(observations)
    week, tow_s = 1900, 126641.7
    assert {(sat, signal) for _, _, sat, signal in rows} == {
        ("G12", "1C"), ("G12", "1W"), ("G12", "2W"), ("G12", "2X"),
        ("R20", "1C"), ("R20", "1P"), ("R20", "2P"), ("R20", "2C"),
        ("E05", "1C"),
        ("G19", "1C"), ("G19", "1W"), ("G19", "2W"), ("G19", "2X"),
    }  # fmt: skip
    assert rows[week, tow_s, "G12", "1W"] == (value_of(0, 0, 4), None, None, None)
    assert rows[week, tow_s, "G19", "2W"] == tuple(value_of(0, 3, column) for column in (6, 7, 9, 8))
    assert rows[week, tow_s, "R20", "2C"] == (value_of(0, 1, 10), None, None, None)


def test_more_observables_than_a_rinex_3_header_line_holds() -> None:
    types = tuple(f"{quantity}{signal}" for signal in ("1C", "1W", "2L", "5Q") for quantity in "CLSD")
    content = text_of(header_3({"G": types}, system="G"), epoch_3(0, ("G12",), columns=16))
    observations = parse_observations(content, "wide.rnx")
    assert observations.issues == ()
    assert observations.signals == ("1C", "1W", "2L", "5Q")
    assert observations.pseudorange_m.tolist() == [value_of(0, 0, column) for column in (0, 4, 8, 12)]
    assert observations.doppler_hz.tolist() == [value_of(0, 0, column) for column in (3, 7, 11, 15)]


def test_rinex_2_phase_goes_with_p1_where_there_is_no_c1() -> None:
    observations = parse_observations(text_of(header_2(("P1", "L1", "S1", "D1")), epoch_2(0)), "p.obs")
    assert rows_of(observations).keys() == {
        (1900, 126641.7, "G12", "1W"),
        (1900, 126641.7, "R20", "1P"),
        (1900, 126641.7, "E05", "1C"),  # the phase alone: Galileo has no P code
        (1900, 126641.7, "G19", "1W"),
    }


def test_rinex_2_beidou_b1_is_written_as_c1_or_c2() -> None:
    for types in (("C1", "L1", "S1", "D1"), ("C2", "L2", "S2", "D2")):
        observations = parse_observations(text_of(header_2(types), epoch_2(0, ("C05",))), "bds.obs")
        assert rows_of(observations) == expected(1, ("C05",), "2I")
    both = ("C1", "L1", "S1", "D1", "C2", "L2", "S2", "D2")
    lines = epoch_2(0, ("C05",), columns=8)
    observations = parse_observations(text_of(header_2(both), lines), "bds.obs")
    assert rows_of(observations) == expected(1, ("C05",), "2I")


@pytest.mark.parametrize(
    ("version", "written", "signal"),
    [("3.02", "1I", "2I"), ("3.04", "1I", "2I"), ("3.02", "1X", "2X"), ("3.04", "1X", "1X"), ("3.04", "1P", "1P")],
)
def test_beidou_band_1_of_older_versions_is_b1i(version: str, written: str, signal: str) -> None:
    types = {"C": tuple(f"{quantity}{written}" for quantity in "CLSD")}
    content = text_of(header_3(types, version=version), epoch_3(0, ("C05",)))
    assert rows_of(parse_observations(content, "bds.rnx")) == expected(1, ("C05",), signal)


def test_a_satellite_number_may_have_a_blank_for_a_zero() -> None:
    two = text_of(header_2(), epoch_2(0, ("G 5", "R20")))
    three = text_of(header_3(), epoch_3(0, ("G 5", "R20")))
    for content in (two, three):
        observations = parse_observations(content, "blank.rnx")
        assert observations.issues == ()
        assert rows_of(observations) == expected(1, ("G05", "R20"))


def test_a_blank_system_in_rinex_2_is_that_of_the_file() -> None:
    gps = parse_observations(text_of(header_2(system="G"), epoch_2(0, ("  5", " 12"))), "g.obs")
    assert rows_of(gps) == expected(1, ("G05", "G12"))
    blank = parse_observations(text_of(header_2(system=" "), epoch_2(0, ("  5", " 12"))), "g.obs")
    assert rows_of(blank) == expected(1, ("G05", "G12"))
    glonass = parse_observations(text_of(header_2(system="R", time="GPS"), epoch_2(0, ("  5", " 12"))), "r.obs")
    assert rows_of(glonass) == expected(1, ("R05", "R12"))


@pytest.mark.parametrize(
    ("system", "time", "ahead_s"),
    [
        ("M", "GPS", 0.0),
        ("M", "GAL", 0.0),
        ("M", "QZS", 0.0),
        ("M", "GLO", 17.0),  # leap seconds in June 2016
        ("M", "BDT", 14.0),
        ("R", "   ", 17.0),
        ("C", "   ", 14.0),
        ("E", "   ", 0.0),
        ("G", "   ", 0.0),
    ],
)
def test_epochs_come_onto_gps_time(system: str, time: str, ahead_s: float) -> None:
    for content in (
        text_of(header_2(system=system, time=time), epoch_2(0)),
        text_of(header_3(system=system, time=time), epoch_3(0)),
    ):
        observations = parse_observations(content, "time.rnx")
        assert observations.issues == ()
        assert observations.gps_week.tolist() == [1900]
        assert observations.tow_s.tolist() == [126641.7 + ahead_s]


def test_utc_epochs_cross_the_leap_second_evenly() -> None:
    moments = ("2016 12 31 23 59 59.5000000", "2016 12 31 23 59 60.5000000", "2017 01 01 00 00  0.5000000")
    epochs = [f"> {moment}  0  0" for moment in moments]
    observations = parse_observations(text_of(header_3(system="R", time="GLO"), epochs), "leap.rnx")
    assert observations.issues == ()
    assert np.diff(observations.gps_week * 604800 + observations.tow_s).tolist() == [1.0, 1.0]


def test_weeks_roll_over() -> None:
    epochs = ["> 2016 06 11 23 59 59.9000000  0  0", "> 2016 06 12 00 00  0.1000000  0  0"]
    observations = parse_observations(text_of(header_3(), epochs), "week.rnx")
    assert observations.gps_week.tolist() == [1900, 1901]
    assert observations.tow_s.tolist() == [604799.9, 0.1]


def test_two_digit_years() -> None:
    epochs = [epoch_2(0)[0].replace("  4G12R20E05G19", "  0"), epoch_2(1)[0].replace("  4G12R20E05G19", "  0")]
    epochs[0] = " 80" + epochs[0][3:]
    observations = parse_observations(text_of(header_2(), epochs), "years.obs")
    assert observations.issues == ()
    # 1980-06-06 is 152 days after the GPS epoch.
    assert observations.gps_week.tolist() == [21, 1900]


def test_trailing_blanks_line_ends_and_byte_order_mark_do_not_matter() -> None:
    for header, epoch in ((header_2(), epoch_2), (header_3(), epoch_3)):
        plain = text_of(header, epoch(0), epoch(1))
        padded = text_of(*([line.ljust(80) for line in part] for part in (header, epoch(0), epoch(1))))
        for content in (padded, plain.replace(b"\n", b"\r\n"), b"\xef\xbb\xbf" + plain, plain[:-1]):
            observations = parse_observations(content, "same.rnx")
            assert observations.issues == ()
            assert rows_of(observations) == expected(2)


def test_columns_without_a_measurement_are_none() -> None:
    zero = f"{0.0:14.3f}  "
    lines = ["> 2016 06 06 11 10 41.7000000  0  3", f"G12  20000000.125  {zero}", f"G13{zero}{zero}", "G14"]
    observations = parse_observations(text_of(header_3({"G": TYPES_3}), lines), "zero.rnx")
    assert observations.issues == ()
    assert [satellite_name(code) for code in observations.satellite.tolist()] == ["G12"]
    assert math.isnan(observations.carrier_phase_cycles[0])


def test_repeated_unordered_and_empty_epochs_stay_as_they_are() -> None:
    for header, epoch in ((header_2(), epoch_2), (header_3(), epoch_3)):
        content = text_of(header, epoch(2), epoch(0), epoch(0), epoch(1, ()))
        observations = parse_observations(content, "order.rnx")
        assert observations.issues == ()
        assert observations.tow_s.tolist() == [126642.2, 126641.7, 126641.7, 126642.0]
        assert np.diff(observations.first_row).tolist() == [4, 4, 4, 0]


def test_a_power_failure_breaks_the_phases() -> None:
    for header, epoch in ((header_2(), epoch_2), (header_3(), epoch_3)):
        observations = parse_observations(text_of(header, epoch(0), epoch(1, flag=1)), "power.rnx")
        assert observations.issues == ()
        assert observations.lock_lost.tolist() == [0] * 4 + [1] * 4


def test_cycle_slip_records_are_passed_over() -> None:
    for header, epoch in ((header_2(), epoch_2), (header_3(), epoch_3)):
        observations = parse_observations(text_of(header, epoch(0), epoch(0, flag=6), epoch(1)), "slips.rnx")
        assert observations.issues == ()
        assert rows_of(observations) == expected(2)


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("flag", [2, 3, 4, 5])
def test_event_records_are_passed_over(flag: int, timed: bool) -> None:  # noqa: FBT001 - a parameter of the test
    records = [header_line("A1", "MARKER NAME"), header_line("seen a tunnel", "COMMENT"), "free text of two words"]
    head_2 = (" 16  6  6 11 10 41.8000000" if timed else " " * 26) + f"  {flag}{len(records):3d}"
    head_3 = ("> 2016 06 06 11 10 41.8000000" if timed else ">" + " " * 28) + f"  {flag}{len(records):3d}"
    for header, epoch, head in ((header_2(), epoch_2, head_2), (header_3(), epoch_3, head_3)):
        observations = parse_observations(text_of(header, epoch(0), [head, *records], epoch(1)), "event.rnx")
        assert observations.issues == ()
        assert rows_of(observations) == expected(2)


def test_comments_in_the_middle_are_passed_over() -> None:
    comment = [header_line("the receiver was warm", "COMMENT")]
    for header, epoch in ((header_2(), epoch_2), (header_3(), epoch_3)):
        lines = epoch(1)
        content = text_of(header, comment, epoch(0), comment, lines[:2], comment, lines[2:], comment)
        observations = parse_observations(content, "comments.rnx")
        assert observations.issues == ()
        assert rows_of(observations) == expected(2)


def test_observables_may_change_in_the_middle() -> None:
    swapped_2, swapped_3 = ("L1", "C1", "D1", "S1"), ("L1C", "C1C", "D1C", "S1C")
    change_2 = [" " * 28 + "4  1", header_2(swapped_2)[1]]
    change_3 = [">" + " " * 30 + "4  3", *header_3(dict.fromkeys("GRE", swapped_3))[1:4]]
    for header, epoch, change in ((header_2(), epoch_2, change_2), (header_3(), epoch_3, change_3)):
        observations = parse_observations(text_of(header, epoch(0), change, epoch(1)), "change.rnx")
        assert observations.issues == ()
        swapped = {
            key: (row[1], row[0], row[3], row[2]) if key[1] > 126641.8 else row for key, row in expected(2).items()
        }
        assert rows_of(observations) == swapped


def test_files_put_after_one_another_are_one() -> None:
    for header, epoch in ((header_2(), epoch_2), (header_3(), epoch_3)):
        observations = parse_observations(text_of(header, epoch(0), header, epoch(1)), "joined.rnx")
        assert observations.issues == ()
        assert rows_of(observations) == expected(2)


def test_progress_rises_to_one() -> None:
    seen: list[float] = []
    parse_observations(text_of(header_3(), epoch_3(0)), "progress.rnx", seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
