"""GPS time against UTC."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.gnss_time import gps_from_calendar, gps_from_unix_ns, leap_seconds, unix_ns_from_gps


@pytest.mark.parametrize(
    ("calendar", "leap"),
    [
        ("2016-06-06T11:10:24.7", 17),
        ("2016-12-31T23:59:59", 17),
        ("2017-01-01T00:00:00", 18),
        ("1980-01-06T00:00:00", 0),
    ],
)
def test_leap_seconds_by_date(calendar: str, leap: int) -> None:
    assert leap_seconds(datetime.fromisoformat(calendar).replace(tzinfo=UTC).timestamp()) == leap


def test_the_berlin_drive_began_at_its_utc_time() -> None:
    t_ns = unix_ns_from_gps(1900, 126641.7)
    assert datetime.fromtimestamp(t_ns / 1e9, UTC).isoformat() == "2016-06-06T11:10:24.700000+00:00"


@given(st.integers(0, 4000), st.integers(0, 604_799_999))
def test_gps_to_unix_and_back(week: int, milliseconds: int) -> None:
    tow_s = milliseconds / 1000
    again = gps_from_unix_ns(unix_ns_from_gps(week, tow_s))
    # During a leap second two GPS instants share one Unix time: then the way back is one second off.
    difference_s = (again[0] - week) * 604_800 + again[1] - tow_s
    assert difference_s == pytest.approx(0.0, abs=1e-6) or difference_s == pytest.approx(1.0, abs=1e-6)


@given(st.datetimes(datetime(1980, 1, 6), datetime(2060, 1, 1)))  # noqa: DTZ001 - GPS time has no zone
def test_calendar_agrees_with_the_standard_library(moment: datetime) -> None:
    week, tow_s = gps_from_calendar(
        moment.year, moment.month, moment.day, moment.hour, moment.minute, moment.second + moment.microsecond / 1e6
    )
    since = moment - datetime(1980, 1, 6)  # noqa: DTZ001 - GPS time has no zone
    assert week * 604_800 + tow_s == pytest.approx(since.total_seconds(), abs=1e-5)
