"""NMEA 0183 sentences of fixes, read back by pynmeagps and by our own reader."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from pynmeagps import NMEAReader

from schemas.gnss import Fix, FixStatus
from services.gnss_receiver.nmea_stream import NmeaStream
from services.gnss_receiver.stream_frames import Framer
from services.nmea_output.sentences import position_report, sentences

T_NS = 1_684_478_000_250_000_000
FIX = Fix(
    t_ns=T_NS,
    gps_week=2262,
    tow_s=455_618.25,
    method="robust",
    status="fix",
    lat_deg=31.18,
    lon_deg=-121.4,
    h_m=30.5,
    ve_mps=3.0,
    vn_mps=-4.0,
    vu_mps=0.1,
    satellites_used=12,
    satellites_flagged=1,
    sigma_horizontal_m=2.0,
    hdop=0.84,
)


def lines(fix: Fix, geoid_m: float | None = None) -> list[str]:
    return sentences(fix, geoid_m).decode("ascii").split("\r\n")[:-1]


def test_a_fix() -> None:
    assert lines(FIX, 10.5) == [
        "$GNGGA,063320.25,3110.800000,N,12124.000000,W,1,12,0.8,20.000,M,10.500,M,,*51",
        "$GNRMC,063320.25,A,3110.800000,N,12124.000000,W,9.719,143.13,190523,,,A,V*1A",
        "$GNGST,063320.25,,,,,1.414,1.414,*64",
    ]


def test_without_a_geoid_height_and_separation_still_add_up() -> None:
    assert ",30.500,M,0.000,M," in lines(FIX)[0]


@pytest.mark.parametrize(("corrected", "quality", "mode"), [(6, "1", "A"), (7, "2", "D"), (12, "2", "D")])
def test_a_fix_is_differential_when_most_satellites_were_corrected(corrected: int, quality: str, mode: str) -> None:
    gga, rmc, _ = lines(replace(FIX, satellites_corrected=corrected))
    assert gga.split(",")[6] == quality
    assert (rmc.split(",")[2], rmc.split(",")[12]) == ("A", mode)


def test_a_prediction_is_called_an_estimate() -> None:
    gga, rmc, _ = lines(replace(FIX, status="predicted"))
    assert gga.split(",")[6] == "6"
    assert rmc.split(",")[2] == "V"
    assert rmc.split(",")[12] == "E"


@pytest.mark.parametrize("fix", [replace(FIX, status="none"), replace(FIX, lat_deg=None)])
def test_no_fix_has_quality_0_and_no_place(fix: Fix) -> None:
    gga, rmc, gst = lines(fix)
    assert gga.startswith("$GNGGA,063320.25,,,,,0,12,,,M,,M,,*")
    assert rmc.startswith("$GNRMC,063320.25,V,,,,,,,190523,,,N,V*")
    assert gst.startswith("$GNGST,063320.25,,,,,,,*")


def test_what_is_not_known_stays_blank() -> None:
    gga, rmc, gst = lines(replace(FIX, h_m=None, ve_mps=None, sigma_horizontal_m=None, hdop=None))
    assert gga.startswith("$GNGGA,063320.25,3110.800000,N,12124.000000,W,1,12,,,M,,M,,*")
    assert rmc.startswith("$GNRMC,063320.25,A,3110.800000,N,12124.000000,W,,,190523,,,A,V*")
    assert gst.startswith("$GNGST,063320.25,,,,,,,*")
    standing = lines(replace(FIX, ve_mps=0.01, vn_mps=0.0))[1]
    assert standing.split(",")[7:9] == ["0.019", ""]


@given(
    st.floats(-90, 90),
    st.floats(-180, 180),
    st.floats(-400, 9000),
    st.floats(-100, 100),
    st.floats(-100, 100),
    st.sampled_from(["fix", "predicted", "none"]),
)
def test_what_is_said_is_understood(
    lat: float, lon: float, h_m: float, ve: float, vn: float, status: FixStatus
) -> None:
    fix = replace(FIX, lat_deg=lat, lon_deg=lon, h_m=h_m, ve_mps=ve, vn_mps=vn, status=status)
    framer, reader = Framer(), NmeaStream(Counter(), T_NS)
    frames = framer.feed(sentences(fix, -20.25))
    assert framer.counts["nmea_frames"] == 3
    for line in lines(fix, -20.25):
        NMEAReader.parse(f"{line}\r\n")
        assert len(line) + 2 <= 90
    heard = [one for frame in frames for one in reader.add(frame.content)] + reader.cut()
    (found,) = heard
    assert (found.t_ns, found.status) == (T_NS, status)
    if status == "none":
        assert found.lat_deg is None
        return
    # A millionth of a minute is 1.7e-8 degrees; heights have millimetres, speeds thousandths of a knot.
    assert found.lat_deg == pytest.approx(lat, abs=1e-8)
    assert found.lon_deg == pytest.approx(lon, abs=1e-8)
    assert found.h_m == pytest.approx(h_m, abs=1e-3)
    if found.ve_mps is not None and found.vn_mps is not None:
        # And courses hundredths of a degree, 2.5 cm/s at 141 m/s.
        assert found.ve_mps == pytest.approx(ve, abs=0.02)
        assert found.vn_mps == pytest.approx(vn, abs=0.02)
    assert found.sigma_horizontal_m == pytest.approx(2.0, abs=1e-3)


@pytest.mark.parametrize(("t_ns", "clock"), [(T_NS + 4_999_999, "063320.25"), (T_NS + 5_000_000, "063320.26")])
def test_times_are_rounded(t_ns: int, clock: str) -> None:
    assert lines(replace(FIX, t_ns=t_ns))[0].split(",")[1] == clock


def test_times_carry_over_midnight() -> None:
    midnight_ns = 1_684_540_800 * 10**9
    gga, rmc, _ = lines(replace(FIX, t_ns=midnight_ns - 1_000_000))
    assert gga.split(",")[1] == "000000.00"
    assert rmc.split(",")[9] == "200523"


def test_the_report_to_a_caster() -> None:
    read = NMEAReader.parse(position_report(T_NS, 31.18, 121.4, 25.0))
    assert (read.msgID, read.quality, read.lat, read.lon, read.alt) == ("GGA", 1, 31.18, 121.4, 25.0)
