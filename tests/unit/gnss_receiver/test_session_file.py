"""Recordings that belong together: one says the day for those that do not."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.gnss_receiver.recording_file import UndatedError
from services.gnss_receiver.rinex_navigation_file import read_navigation
from services.gnss_receiver.rinex_observation_file import read_observations
from services.gnss_receiver.rtcm_ephemerides import write_ephemeris
from services.gnss_receiver.rtcm_messages import framed
from services.gnss_receiver.session_file import began_ns, read_session
from tests.unit.gnss_receiver.broadcast_samples import WEEK, glonass, kepler
from tests.unit.gnss_receiver.stream_samples import NEAR_NS, ROWS, TOW_S, epoch, rawx, rtcm_of

TEN_YEARS_WEEKS = 522
GPS_ROW = [(0, 3, 0, 24_600_079.188, 129_000_000.0, 12.0, 64_500, 51, 7)]


@pytest.fixture
def undated(tmp_path: Path) -> Path:
    """A recording of multiple signal messages alone."""
    path = tmp_path / "base.rtcm3"
    path.write_bytes(b"".join(rtcm_of(epoch(TOW_S + second) for second in range(3))))
    return path


@pytest.fixture
def orbits(tmp_path: Path) -> Path:
    """A recording of ephemerides: GPS counts weeks modulo 1024, GLONASS days."""
    path = tmp_path / "orbits.rtcm3"
    path.write_bytes(b"".join(framed(write_ephemeris(one)) for one in (kepler("G05"), glonass())))
    return path


def test_the_rover_dates_what_was_recorded_beside_it(tmp_path: Path, undated: Path, orbits: Path) -> None:
    rover = tmp_path / "rover.ubx"
    rover.write_bytes(rawx(GPS_ROW) + rawx(GPS_ROW, TOW_S + 1.0))
    observations, navigation = read_session(rover, [orbits])
    assert [(one.satellite, one.gps_week, one.toe_s) for one in navigation.ephemerides] == [
        (one.satellite, one.gps_week, one.toe_s) for one in (kepler("G05"), glonass())
    ]
    base = read_observations(undated, beside_ns=began_ns(observations))
    assert base.gps_week.tolist() == [WEEK] * 3
    assert base.tow_s.tolist() == [TOW_S, TOW_S + 1.0, TOW_S + 2.0]
    assert len(base.satellite) == 3 * len(ROWS)


def test_ephemerides_date_the_rover(undated: Path, orbits: Path) -> None:
    observations, navigation = read_session(undated, [orbits])
    assert observations.gps_week.tolist() == [WEEK] * 3
    assert [one.satellite for one in navigation.ephemerides] == ["G05", "R09"]


def test_weeks_modulo_1024_are_those_of_the_recording_beside(orbits: Path) -> None:
    later_ns = NEAR_NS + 2 * TEN_YEARS_WEEKS * 7 * 86_400 * 10**9
    (gps, _) = read_navigation([orbits], beside_ns=later_ns).ephemerides
    assert gps.gps_week == WEEK + 1024


def test_nothing_that_names_the_day_is_said_so(tmp_path: Path, undated: Path) -> None:
    empty = tmp_path / "empty.rtcm3"
    empty.write_bytes(undated.read_bytes())
    with pytest.raises(UndatedError, match=r"names the day; say when it was recorded"):
        read_session(undated, [empty])


def test_a_recording_without_epochs_says_no_time(undated: Path, orbits: Path) -> None:
    assert began_ns(read_observations(undated, beside_ns=NEAR_NS)) == NEAR_NS
    assert began_ns(read_observations(orbits)) is None
