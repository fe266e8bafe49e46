"""NMEA 0183 streams: sentences of one instant make one position, and nothing is made up."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.gnss import OwnPosition
from tests.unit.gnss_receiver.stream_samples import NEAR_NS, gga, gst, listen, nmea, pvt, rmc

DAY_NS = 86_400 * 10**9
CYCLES = [f"0633{20 + second}.00" for second in range(4)]


def positions(*sentences: bytes, near_ns: int = NEAR_NS) -> list[OwnPosition]:
    return [one for one in listen(b"".join(sentences), near_ns=near_ns)[0] if isinstance(one, OwnPosition)]


def test_sentences_of_one_instant_make_one_position() -> None:
    found = positions(*(sentence for clock in CYCLES for sentence in (gga(clock), rmc(clock), gst(clock))))
    assert [one.t_ns for one in found] == [NEAR_NS + second * 10**9 for second in range(4)]
    one = found[0]
    assert (one.protocol, one.status, one.mode) == ("nmea", "fix", "autonomous")
    assert one.lat_deg == pytest.approx(31.18, abs=1e-9)
    assert one.lon_deg == pytest.approx(121.4, abs=1e-9)
    assert one.h_m == 30.5
    # Ten knots due east.
    assert one.ve_mps == pytest.approx(10 * 1852 / 3600)
    assert one.vn_mps == pytest.approx(0.0, abs=1e-12)
    assert one.sigma_horizontal_m == 5.0
    assert one.sigma_vertical_m == 6.0
    assert (one.satellites_used, one.hdop, one.correction_age_s) == (12, 0.8, 1.5)


def test_a_position_comes_as_soon_as_its_sentences_are_there() -> None:
    first = (gga(CYCLES[0]), rmc(CYCLES[0]))
    # Of the first instant nobody knows what belongs to it; from then on the last sentence completes it.
    assert len(positions(*first)) == 0
    assert len(positions(*first, gga(CYCLES[1]))) == 1
    assert len(positions(*first, gga(CYCLES[1]), rmc(CYCLES[1]))) == 2
    # A sentence that stays away, or comes late, holds nothing up for ever.
    assert len(positions(*first, gga(CYCLES[1]), gga(CYCLES[2]))) == 3
    assert len(positions(*first, gga(CYCLES[1]), rmc(CYCLES[1]), gst(CYCLES[1]), gga(CYCLES[2]))) == 2


@pytest.mark.parametrize(
    ("sentences", "status", "mode"),
    [
        ([gga(quality=0)], "none", "none"),
        ([gga(quality=2)], "fix", "differential"),
        ([gga(quality=4)], "fix", "rtk_fixed"),
        ([gga(quality=6)], "predicted", "estimated"),
        ([gga(quality=8)], "none", "simulated"),
        ([gga(quality=7)], "none", "manual"),
        ([gga(quality=1), rmc(status="V", mode="N")], "none", "none"),
        ([gga(quality=6), rmc(status="V", mode="E")], "predicted", "estimated"),
        ([rmc()], "fix", "differential"),
        ([rmc(status="V", mode="N")], "none", "none"),
        ([nmea("GPRMC,063320.00,A,3110.80000,N,12124.00000,E,10.0,90.0,190523,,")], "fix", "autonomous"),
        ([nmea("GNGGA,063320.00,,,,,0,00,99.9,,M,,M,,")], "none", "none"),
        ([nmea("GNGGA,063320.00,,,,,1,05,1.0,,M,,M,,")], "none", "none"),
    ],
)
def test_a_position_is_called_what_it_is(sentences: list[bytes], status: str, mode: str) -> None:
    found = positions(*sentences, gga(CYCLES[1]))[0]
    assert (found.status, found.mode) == (status, mode)
    assert (found.lat_deg is None) == (status == "none")


def test_what_is_not_said_is_not_there() -> None:
    found = positions(nmea("GNGGA,063320.00,3110.8,S,12124.0,W,1,,,,M,,M,,"), gga(CYCLES[1]))[0]
    assert found.lat_deg == pytest.approx(-31.18)
    assert found.lon_deg == pytest.approx(-121.4)
    assert (found.h_m, found.ve_mps, found.satellites_used, found.hdop) == (None, None, None, None)
    assert found.sigma_horizontal_m is None
    # A height without the geoid is no ellipsoidal height; a speed without a course is no velocity.
    found = positions(nmea("GNGGA,063320.00,3110.8,N,12124.0,E,1,05,1.0,20.0,M,,M,,"), gga(CYCLES[1]))[0]
    assert found.h_m is None
    found = positions(nmea("GNRMC,063320.00,A,3110.8,N,12124.0,E,3.0,,190523,,,A"), gga(CYCLES[1]))[0]
    assert found.vn_mps is None
    found = positions(nmea("GNRMC,063320.00,A,3110.8,N,12124.0,E,0.0,,190523,,,A"), gga(CYCLES[1]))[0]
    assert (found.ve_mps, found.vn_mps) == (0.0, 0.0)


def test_days_come_from_sentences_or_from_around_the_clock() -> None:
    assert positions(rmc(day="200523"), gga(CYCLES[1]))[0].t_ns == NEAR_NS + DAY_NS
    zda = nmea("GNZDA,063320.00,18,05,2023,00,00")
    assert positions(gga(), zda, gga(CYCLES[1]))[0].t_ns == NEAR_NS - DAY_NS
    for away in (-0.49, 0.49):
        assert positions(gga(), gga(CYCLES[1]), near_ns=NEAR_NS + round(away * DAY_NS))[0].t_ns == NEAR_NS
    midnight = [
        nmea(f"GNGGA,{clock},3110.8,N,12124.0,E,1,05,1.0,20.0,M,10.0,M,,") for clock in ("235959.50", "000000.00")
    ]
    found = positions(*midnight, gga("000000.50"), near_ns=NEAR_NS)
    assert found[1].t_ns - found[0].t_ns == 500_000_000


def test_dates_that_are_1024_weeks_behind_are_repaired() -> None:
    # 2023-05-19 less 1024 weeks is 2003-10-03: receivers whose week number turned over say so.
    heard, receiver = listen(rmc(day="031003") + gga(CYCLES[1]))
    assert isinstance(heard[0], OwnPosition)
    assert heard[0].t_ns == NEAR_NS
    assert receiver.counts["dates_1024_weeks_behind"] == 1


def test_leap_seconds_are_times() -> None:
    found = positions(nmea("GNGGA,235960.25,3110.8,N,12124.0,E,1,05,1.0,20.0,M,10.0,M,,"), gga("000000.00"))[0]
    assert found.t_ns % DAY_NS == 250_000_000


@pytest.mark.parametrize("clock", ["246000.00", "126000", "1234", "12345x", "123461.0"])
def test_times_that_cannot_be_are_counted(clock: str) -> None:
    heard, receiver = listen(gga(clock) + gga(CYCLES[0]) + gga(CYCLES[1]))
    assert receiver.counts["bad_nmea_GGA"] == 1
    assert len(heard) == 2


def test_sentences_of_other_kinds_are_counted_by_their_name() -> None:
    _, receiver = listen(
        nmea("GPGSV,1,1,00") + nmea("PUBX,00,1") + nmea("GNGLL,,,,,,V") + nmea("X") + nmea("GNGGA,,,,,,0,,,,,,,,")
    )
    assert {name: receiver.counts[name] for name in receiver.counts if name.startswith("not_read")} == {
        "not_read_nmea_GSV": 1,
        "not_read_nmea_UBX": 1,
        "not_read_nmea_GLL": 1,
        "not_read_nmea_X": 1,
    }


def test_a_receiver_that_says_it_in_ubx_too_is_not_heard_twice() -> None:
    heard, receiver = listen(gga(CYCLES[0]) + gga(CYCLES[1]) + pvt() + gga(CYCLES[2]) + pvt())
    assert [one.protocol for one in heard if isinstance(one, OwnPosition)] == ["nmea", "nmea", "ubx", "ubx"]
    assert receiver.counts["positions_twice"] == 1


@settings(max_examples=200)
@given(
    st.sampled_from(["GNGGA", "GNRMC", "GNGST", "GNZDA"]),
    st.lists(
        st.text(st.characters(min_codepoint=32, max_codepoint=126, exclude_characters="$*,"), max_size=8), max_size=16
    ),
)
def test_no_sentence_makes_it_fail(kind: str, fields: list[str]) -> None:
    for one in positions(nmea(",".join([kind, "063320.00", *fields])), gga(CYCLES[1])):
        for value in (one.lat_deg, one.lon_deg, one.h_m, one.ve_mps, one.sigma_horizontal_m):
            assert value is None or math.isfinite(value)
