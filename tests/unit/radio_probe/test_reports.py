from __future__ import annotations

import json

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.radio import RadioMeasurement, Weather
from services.radio_probe.device_reports import RowReports
from services.radio_probe.reading_check import ReadingCheck
from services.radio_probe.report_rows import LONGEST, CsvRows, Lines
from services.radio_probe.settings import RadioInput

NS = 10**9


def reports(**fields: object) -> RowReports:
    return RowReports(msgspec.convert({"device": "logger", "file": "log", **fields}, RadioInput), "onboard")


@pytest.mark.parametrize(
    "time",
    [
        "2026-10-26T07:33:19.5Z",
        "2026-10-26 16:33:19.500+09:00",
        "1792999999.5",
        "1792999999500",
        "1792999999500000",
        "1792999999500000000",
    ],
)
def test_times_in_many_spellings(time: str) -> None:
    (one,) = reports().feed(f"time,power_dbm\n{time},-70\n".encode())
    assert one.t_ns == 1_792_999_999_500_000_000


def test_names_of_passes_csv_are_understood() -> None:
    text = (
        "time,pass_id,radio,channel,direction,chainage_m,power_dbm,cell,decoded_power_dbm,received_ratio\n"
        "2026-10-26T07:33:20Z,T1-7,R02,ch2,down,7200.5,-71.2,R02,,0.0\n"
    )
    assert reports().feed(text.encode()) == [
        RadioMeasurement(
            t_ns=1_793_000_000 * NS,
            radio="R02",
            channel="ch2",
            direction="down",
            pass_id="T1-7",
            chainage_m=7200.5,
            channel_power_dbm=-71.2,
            cell="R02",
            received_ratio=0.0,
        )
    ]


def test_json_lines_with_what_is_wrong() -> None:
    reader = reports(format="json", channel="ch9")
    lines = [
        {"power_dbm": -70, "shoe_size": 44},
        {"power_dbm": "x"},
        [1],
        {"power_dbm": -71, "direction": "left"},
        {"power_dbm": -72, "received_ratio": None},
    ]
    found = reader.feed(b"".join(json.dumps(one).encode() + b"\n" for one in lines) + b"{broken\n")
    assert [getattr(one, "channel_power_dbm", None) for one in found] == [-70.0, None, -72.0]
    assert all(one.t_ns == 0 and getattr(one, "channel", "") == "ch9" for one in found)
    assert reader.counts == {
        "broken_lines": 3,
        "unknown_columns": 1,
        "times_without_zone": 0,
        "not_a_number": 1,
    }


def test_a_header_may_come_again_and_cells_must_be_as_many() -> None:
    rows = CsvRows()
    assert rows.row("a, b") == ""
    assert rows.row("1, 2") == {"a": "1", "b": "2"}
    assert rows.row("a, b") == ""
    assert rows.row("1,") == {"a": "1"}
    assert rows.row("1") == "1 cells for 2 columns"
    assert CsvRows().row("a,a") == "the first line names no columns"
    assert CsvRows(("a",)).row("3") == {"a": "3"}


def test_a_line_without_an_end_is_thrown_away() -> None:
    lines = Lines()
    assert lines.feed(b"x" * (LONGEST + 1)) == []
    assert lines.feed(b"y" * LONGEST) == []
    assert lines.feed(b"z\nnext\n") == ["next"]
    assert lines.too_long == 1


@given(st.binary(max_size=500), st.sampled_from(["csv", "json"]), st.sampled_from(["radio", "weather"]))
def test_any_bytes_make_messages_that_can_be_judged(octets: bytes, kind: str, carries: str) -> None:
    reader = reports(format=kind, carries=carries, axis_m=0.0)
    check = ReadingCheck(300.0)
    reader.feed(b"time,power_dbm,temperature_c,channel\n")
    for one in (*reader.feed(octets), *reader.feed(b"\n" + octets + b"\n")):
        if isinstance(one, Weather):
            check.weather("logger", one, 0, "checked")
        else:
            check.reading("logger", one, 0, "checked")


@given(
    st.dictionaries(
        st.sampled_from(["power_dbm", "time", "received_ratio", "direction", "radio"]), st.text(max_size=12)
    )
)
def test_any_cells_are_read_or_refused(row: dict[str, str]) -> None:
    reader = reports(format="json")
    found = reader.feed(json.dumps(row).encode() + b"\n")
    assert len(found) + reader.counts["broken_lines"] == 1


@given(st.floats(), st.sampled_from(["channel_power_dbm", "decoded_power_dbm", "temperature_c", "tx_power_dbm"]))
def test_whatever_is_let_through_is_a_number_within_reason(value: float, name: str) -> None:
    check = ReadingCheck(300.0)
    message = RadioMeasurement(t_ns=0, radio="R", channel="1", received_ratio=1.0)
    passed = check.reading("radio", msgspec.structs.replace(message, **{name: value}), 5, "checked")
    assert (passed is None) == (check.counts.get("absurd", 0) == 1)
    if passed is not None:
        assert abs(getattr(passed, name)) <= 180.0
        assert passed.t_ns == 5
