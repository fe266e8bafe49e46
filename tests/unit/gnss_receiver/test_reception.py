"""What stands around a live source: its configuration, its pauses, its log, its rate, its password."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from schemas.gnss_time import unix_ns_from_gps
from services.byte_source.rate_watch import RateWatch
from services.byte_source.settings import SerialSource, TcpSource
from services.byte_source.source import RetryPauses
from services.gnss_receiver.password_file import read_password
from services.gnss_receiver.raw_log_file import RawLogFile
from services.gnss_receiver.reception import (
    FileSource,
    NtripSource,
    Reception,
    Source,
    recorded_ns,
)
from services.gnss_receiver.recording_file import read_recording
from services.gnss_receiver.rinex_error import RinexError
from services.gnss_receiver.rinex_navigation_file import read_navigation
from services.gnss_receiver.rinex_observation_file import read_observations
from services.gnss_receiver.rtcm_ephemerides import write_ephemeris
from services.gnss_receiver.rtcm_messages import framed
from services.gnss_receiver.service import Config
from tests.unit.gnss_receiver.broadcast_samples import kepler
from tests.unit.gnss_receiver.stream_samples import NEAR_NS, TOW_S, WEEK, epoch, gga, rawx, rmc, rtcm_of, sfrbx
from tests.unit.gnss_receiver.test_ubx_stream import ROWS


@pytest.mark.parametrize(
    ("table", "source"),
    [
        ({"serial": {"port": "/dev/ttyACM0", "baud": 460_800}}, SerialSource(port="/dev/ttyACM0", baud=460_800)),
        ({"tcp": {"host": "10.0.0.7", "port": 3000}}, TcpSource(host="10.0.0.7", port=3000)),
        ({"ntrip": {"host": "c", "mountpoint": "B"}}, NtripSource(host="c", mountpoint="B")),
        ({"file": {"path": "x.ubx"}}, FileSource(path="x.ubx")),
    ],
)
def test_sources(table: dict[str, object], source: Source) -> None:
    assert msgspec.convert(table | {"device": "rear"}, Config).source == source


@pytest.mark.parametrize(
    "table",
    [
        {},
        {"observations": "a.obs", "file": {"path": "x"}},
        {"pigeon": {}},
        {"tcp": {"host": "h", "port": 0}},
        {"ntrip": {"host": "h", "mountpoint": "a b"}},
        {"ntrip": {"host": "h", "mountpoint": "m", "password": "secret"}},
        {"observations": "a.obs", "silence_s": 0.0},
    ],
)
def test_configurations_that_cannot_be(table: dict[str, object]) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(table, Config)


def test_two_sources_or_none_are_told_in_words() -> None:
    with pytest.raises(ValueError, match=r"^give one of observations .*, serial, tcp, ntrip and file$"):
        Reception()
    with pytest.raises(ValueError, match=r"and file, not observations and file$"):
        Reception(observations="a.obs", file=FileSource(path="x"))


def test_the_day_of_a_recording() -> None:
    assert recorded_ns(FileSource(path="x")) is None
    noon_ns = recorded_ns(FileSource(path="x", recorded="2023-05-19"))
    assert noon_ns is not None
    assert abs(noon_ns - NEAR_NS) < 12 * 3600 * 10**9
    with pytest.raises(ValueError, match="2023-02-30"):
        recorded_ns(FileSource(path="x", recorded="2023-02-30"))


def test_pauses_double_up_to_half_a_minute() -> None:
    pauses = RetryPauses()
    assert [pauses.take() for _ in range(7)] == [1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0]
    pauses.reset()
    assert pauses.take() == 1.0


def watched(expected_hz: float, times_s: list[float], now_s: float) -> str:
    watch = RateWatch(expected_hz, 0.0)
    for time_s in times_s:
        watch.heard(time_s)
    return watch.fault(now_s)


def test_rates() -> None:
    five = [index / 5 for index in range(100)]
    assert watched(5.0, five, 19.8) == ""
    assert watched(5.0, five, 30.0) == "0 epochs per second instead of 5"
    assert watched(10.0, five, 19.8) == "5 epochs per second instead of 10"
    assert watched(2.0, five, 19.8) == "5 epochs per second instead of 2"
    # Too early to say, not asked for, one epoch lost of ten: no fault.
    assert watched(5.0, [], 4.9) == ""
    assert watched(0.0, [], 1e6) == ""
    assert watched(1.0, [float(index) for index in range(100) if index != 97], 99.5) == ""
    # Rare epochs have a longer window.
    assert watched(0.1, [0.0, 10.0, 20.0, 30.0], 39.0) == ""
    assert watched(0.1, [0.0], 60.0) == "0 epochs per second instead of 0.1"


def test_logs_take_turns(tmp_path: Path) -> None:
    path = tmp_path / "raw" / "front.bin"
    log = RawLogFile(path, 10, 3)
    for number in range(7):
        log.append(b"%d" % number * 4)
    log.close()
    assert path.read_bytes() == b"6666"
    assert path.with_name("front.bin.1").read_bytes() == b"44445555"
    assert path.with_name("front.bin.2").read_bytes() == b"22223333"
    assert not path.with_name("front.bin.3").exists()
    # What stood there before is continued.
    again = RawLogFile(path, 10, 3)
    again.append(b"x")
    again.close()
    assert path.read_bytes() == b"6666x"


def test_a_single_log_begins_anew(tmp_path: Path) -> None:
    log = RawLogFile(tmp_path / "log", 4, 1)
    log.append(b"abcd")
    log.append(b"ef")
    log.close()
    assert [one.name for one in tmp_path.iterdir()] == ["log"]
    assert (tmp_path / "log").read_bytes() == b"ef"


def test_a_log_that_cannot_be_written_says_so(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    log = RawLogFile(tmp_path / "file" / "log", 10, 3)
    log.append(b"abc")
    assert log.error.startswith(f"the raw log {tmp_path}/file/log cannot be written: ")


def test_passwords(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "secret").write_text("hush\n", "utf-8")
    monkeypatch.setenv("CASTER_PASSWORD", "quiet")
    assert read_password(str(tmp_path / "secret"), "CASTER_PASSWORD") == "hush"
    assert read_password("", "CASTER_PASSWORD") == "quiet"
    assert read_password("", "") == ""
    monkeypatch.delenv("CASTER_PASSWORD")
    with pytest.raises(ValueError, match="the variable CASTER_PASSWORD"):
        read_password("", "CASTER_PASSWORD")
    with pytest.raises(FileNotFoundError):
        read_password(str(tmp_path / "nowhere"), "")


EPOCHS = b"".join(rtcm_of([epoch(TOW_S + second) for second in range(3)]))


def test_recordings_of_receivers_are_read_like_rinex(tmp_path: Path) -> None:
    path = tmp_path / "rover.rtcm3"
    path.write_bytes(EPOCHS + framed(write_ephemeris(kepler("G05"))) + b"\xd3\x00\x01abc" + bytes(10) + EPOCHS[:1])
    observations = read_observations(path)
    assert observations.gps_week.tolist() == [WEEK] * 3
    assert observations.tow_s.tolist() == [TOW_S, TOW_S + 1, TOW_S + 2]
    navigation = read_navigation([path])
    assert [one.satellite for one in navigation.ephemerides] == ["G05"]
    assert [str(issue) for issue in observations.issues] == [f"{path}: 17 bytes skipped", f"{path}: 1 rtcm3 crc errors"]


def test_recordings_that_do_not_name_their_day_must_be_told_it(tmp_path: Path) -> None:
    path = tmp_path / "base.rtcm3"
    path.write_bytes(EPOCHS)
    with pytest.raises(RinexError, match=r"base\.rtcm3: no message in it names the day; say when it was recorded"):
        read_observations(path)
    assert read_recording(path, NEAR_NS).observations.gps_week.tolist() == [WEEK] * 3
    path.write_bytes(b"hello")
    with pytest.raises(RinexError, match="holds no RTCM 3, UBX or NMEA messages"):
        read_recording(path)


@pytest.mark.parametrize(
    "dated",
    [
        rawx(ROWS),
        rmc() + gga("063321.00"),
        framed((1013 << 4).to_bytes(2, "big") + b"\x00" + (60_083).to_bytes(2, "big") + b"\x2e\x1a\x00\x09\x00"),
        framed(write_ephemeris(kepler("C30"))),
    ],
    ids=["ubx", "nmea", "1013", "ephemeris"],
)
def test_whatever_names_the_day_dates_a_recording(tmp_path: Path, dated: bytes) -> None:
    path = tmp_path / "log"
    # Subframes and a GGA before it name none.
    path.write_bytes(sfrbx(0, 5, 0, [0] * 10) + gga() + EPOCHS + dated)
    assert {one.gps_week for one in map(read_recording(path).observations.epoch, range(3))} == {WEEK}
    assert unix_ns_from_gps(WEEK, TOW_S) == NEAR_NS
