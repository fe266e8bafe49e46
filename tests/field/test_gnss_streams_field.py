"""Real streams of receivers against what RTKLIB's convbin made RINEX of.

KIROTEI_FIELD_DATA names the folder that holds gnss/.
"""

from __future__ import annotations

import os
from collections import Counter
from functools import lru_cache
from math import radians
from pathlib import Path

import numpy as np
import pytest

from schemas.gnss import Ephemeris, Epoch, OwnPosition
from schemas.gnss_time import unix_ns_from_gps
from services.gnss_receiver.heard import Heard, StationPosition
from services.gnss_receiver.nmea_stream import NmeaStream
from services.gnss_receiver.receiver_stream import ReceiverStream
from services.gnss_receiver.recording_file import heard_in
from services.gnss_receiver.rinex_navigation_file import read_navigation
from services.gnss_receiver.rinex_observation_file import read_observations
from services.gnss_receiver.rtcm_ephemerides import read_ephemeris, write_ephemeris
from services.gnss_receiver.rtcm_messages import framed, number_of
from services.gnss_receiver.rtcm_msm_writing import MsmWriter
from services.gnss_receiver.stream_frames import Framer
from services.numerics.geodesy import ecef_from_geodetic

ROOT = Path(os.environ.get("KIROTEI_FIELD_DATA", "/nonexistent")) / "gnss"
pytestmark = pytest.mark.skipif(not ROOT.is_dir(), reason="KIROTEI_FIELD_DATA does not name a folder with gnss/")

SHANGHAI_NS = unix_ns_from_gps(2262, 455_000.0)
STREAMS = {
    "shanghai_dgps/rover.rtcm3": "shanghai_dgps/rover.obs",
    "shanghai_dgps/base.rtcm3": "shanghai_dgps/base.obs",
    "boulder_4hz/rover.ubx": "boulder_4hz/rover.obs",
}
NOT_IN_CONVBIN = {
    # Of 2.4.3: signals of BeiDou and L5 that it does not know in UBX, and those beyond its frequencies in RTCM.
    "shanghai_dgps/rover.rtcm3": {"C5P"},
    "shanghai_dgps/base.rtcm3": {"C5P", "C1P"},
    "boulder_4hz/rover.ubx": {"G5Q", "E5Q", "E6B", "C1P", "C5P", "C6I"},
}


@lru_cache(maxsize=3)
def heard_from(name: str) -> tuple[tuple[Heard, ...], Counter[str]]:
    stream = ReceiverStream(SHANGHAI_NS)
    return tuple(heard_in((ROOT / name).read_bytes(), stream)), stream.counts


def epochs_of(name: str) -> list[Epoch]:
    return [one for one in heard_from(name)[0] if isinstance(one, Epoch)]


@pytest.mark.parametrize("name", STREAMS)
def test_epochs_and_satellites_are_those_of_convbin(name: str) -> None:
    observations, epochs = read_observations(ROOT / STREAMS[name]), epochs_of(name)
    assert len(epochs) == len(observations)
    more: Counter[str] = Counter()
    for index, ours in enumerate(epochs):
        theirs = observations.epoch(index)
        assert (ours.gps_week, round(ours.tow_s, 3)) == (theirs.gps_week, round(theirs.tow_s, 3))
        our_names = set(zip(ours.satellites, ours.signals, strict=True))
        their_names = set(zip(theirs.satellites, theirs.signals, strict=True))
        assert their_names <= our_names
        more.update(satellite[0] + signal for satellite, signal in our_names - their_names)
    assert set(more) <= NOT_IN_CONVBIN[name]


@pytest.mark.parametrize("name", STREAMS)
def test_measurements_are_those_of_convbin(name: str) -> None:
    observations = read_observations(ROOT / STREAMS[name])
    compared: Counter[str] = Counter()
    for index, ours in enumerate(epochs_of(name)):
        theirs = observations.epoch(index)
        place = {key: at for at, key in enumerate(zip(ours.satellites, ours.signals, strict=True))}
        rows = [place[key] for key in zip(theirs.satellites, theirs.signals, strict=True)]
        # RINEX has three digits: half of the last one, and for Doppler the rounding of both roads.
        for column, within in (
            ("pseudorange_m", 0.00051),
            ("carrier_phase_cycles", 0.00051),
            ("doppler_hz", 0.0011),
            ("cn0_dbhz", 0.00051),
        ):
            a, b = getattr(ours, column)[rows], getattr(theirs, column)
            # convbin leaves out phases that the receiver calls noisy, which is for the reader to judge.
            assert not (np.isnan(a) & np.isfinite(b)).any(), column
            both = np.isfinite(a) & np.isfinite(b)
            assert np.abs(a - b)[both].max(initial=0.0) <= within, column
            compared[column] += int(both.sum())
    assert min(compared["pseudorange_m"], compared["cn0_dbhz"]) > 10_000


@pytest.mark.parametrize(
    ("name", "navigation", "fewest"),
    [
        ("shanghai_dgps/rover.rtcm3", "shanghai_dgps/nav.rnx", 60),
        ("boulder_4hz/rover.ubx", "boulder_4hz/nav.rnx", 11),
    ],
)
def test_ephemerides_are_those_of_convbin(name: str, navigation: str, fewest: int) -> None:
    ours = {
        (one.satellite, one.gps_week, one.toe_s, one.issue): one
        for one in heard_from(name)[0]
        if isinstance(one, Ephemeris)
    }
    theirs = read_navigation([ROOT / navigation]).ephemerides
    assert len(theirs) >= fewest
    for one in theirs:
        found = ours[one.satellite, one.gps_week, one.toe_s, one.issue]
        for field in Ephemeris.__struct_fields__:
            a, b = getattr(found, field), getattr(one, field)
            if field == "orbit":
                for part in a.__struct_fields__:
                    # RINEX has thirteen digits.
                    assert getattr(a, part) == pytest.approx(getattr(b, part), rel=1e-11), (one.satellite, part)
            elif isinstance(a, float):
                assert a == pytest.approx(b, rel=1e-11), (one.satellite, field)
            elif field != "t_ns":
                # Which of several transmissions is meant differs.
                assert a == b, (one.satellite, field)


def test_nothing_is_refused_in_streams_that_are_whole() -> None:
    for name in STREAMS:
        counts = heard_from(name)[1]
        faults = [one for one in counts if one.startswith(("bad_", "bytes_skipped", "unknown")) or "errors" in one]
        assert faults == [], name


def test_the_base_says_where_it_is() -> None:
    places = {one for one in heard_from("shanghai_dgps/base.rtcm3")[0] if isinstance(one, StationPosition)}
    assert places == {StationPosition(1665, (-2845676.411, 4661619.4022, 3283215.3241))}


def test_own_positions_agree_with_each_other() -> None:
    heard = [one for one in heard_from("boulder_4hz/rover.ubx")[0] if isinstance(one, OwnPosition)]
    assert len(heard) == 536
    assert {one.protocol for one in heard} == {"ubx"}
    nmea, framer = NmeaStream(Counter(), SHANGHAI_NS), Framer()
    sentences = [one for one in framer.feed((ROOT / "boulder_4hz/rover.ubx").read_bytes()) if one.protocol == "nmea"]
    said = [one for frame in sentences for one in nmea.add(frame.content)]
    assert len(said) >= 535
    for a, b in zip(heard, said, strict=False):
        # The same position through two protocols: 1e-7 degrees in one, 1e-5 minutes in the other, heights in mm.
        assert place_m(a) == pytest.approx(place_m(b), abs=0.02)


def place_m(position: OwnPosition) -> tuple[float, float, float]:
    assert position.lat_deg is not None
    assert position.lon_deg is not None
    assert position.h_m is not None
    x, y, z = ecef_from_geodetic(radians(position.lat_deg), radians(position.lon_deg), position.h_m)
    return float(x), float(y), float(z)


@pytest.mark.parametrize("name", STREAMS)
def test_real_epochs_go_through_rtcm_unharmed(name: str) -> None:
    writer = MsmWriter(1)
    epochs = epochs_of(name)[:60]
    channels = {"R04": 6, "R05": 1, "R09": -2, "R19": 3, "R20": 2}
    frames = [b"".join(framed(one) for one in writer.messages(epoch, channels)) for epoch in epochs]
    stream = ReceiverStream(epochs[0].t_ns)
    again = [one for one in heard_in(b"".join(frames), stream) if isinstance(one, Epoch)]
    assert len(again) == len(epochs)
    for ours, wanted in zip(again, epochs, strict=True):
        assert ours.tow_s == pytest.approx(wanted.tow_s, abs=0.0005)
        place = {key: at for at, key in enumerate(zip(wanted.satellites, wanted.signals, strict=True))}
        rows = [place[key] for key in zip(ours.satellites, ours.signals, strict=True)]
        for column, within in (("pseudorange_m", 0.0003), ("cn0_dbhz", 0.032), ("doppler_hz", 0.001)):
            a, b = getattr(ours, column), getattr(wanted, column)[rows]
            # MSM7 has room for rates that differ by 1.6 m/s between a satellite's signals; a reflected one may not fit.
            lost = np.isnan(a) & np.isfinite(b)
            assert lost.mean() <= (0.05 if column == "doppler_hz" else 0.0), column
            assert not (np.isfinite(a) & np.isnan(b)).any(), column
            assert np.nanmax(np.abs(a - b), initial=0.0) <= within, column
        cycles = ours.carrier_phase_cycles - wanted.carrier_phase_cycles[rows]
        assert np.nanmax(np.abs(cycles - np.round(cycles)), initial=0.0) < 0.001


def test_real_ephemerides_go_through_rtcm_unharmed() -> None:
    for name in ("shanghai_dgps/rover.rtcm3", "boulder_4hz/rover.ubx"):
        for one in heard_from(name)[0]:
            if isinstance(one, Ephemeris):
                message = write_ephemeris(one)
                again = read_ephemeris(number_of(message), message, one.t_ns)
                assert (again.satellite, again.gps_week, again.toe_s) == (one.satellite, one.gps_week, one.toe_s)
                assert (again.issue, again.healthy, again.accuracy_m) == (one.issue, one.healthy, one.accuracy_m)
                for part in one.orbit.__struct_fields__:
                    assert getattr(again.orbit, part) == pytest.approx(getattr(one.orbit, part), rel=1e-13), part
