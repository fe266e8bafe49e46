"""Broadcast messages with the figures of real satellites. KIROTEI_FIELD_DATA names the folder that holds gnss/."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from schemas.gnss import Ephemeris, KeplerOrbit, StateVectorOrbit
from schemas.gnss_time import NS, WEEK_S, unix_ns_from_gps
from services.gnss_receiver.bit_fields import BitWriter
from services.gnss_receiver.fnav_pages import FnavCollector
from services.gnss_receiver.inav_pages import InavCollector
from services.gnss_receiver.rinex_navigation_file import read_navigation
from services.gnss_receiver.rtcm_ephemerides import read_ephemeris, write_ephemeris
from services.gnss_receiver.stream_frames import Framer

ROOT = Path(os.environ.get("KIROTEI_FIELD_DATA", "/nonexistent")) / "gnss"
pytestmark = pytest.mark.skipif(not ROOT.is_dir(), reason="KIROTEI_FIELD_DATA does not name a folder with gnss/")

BOULDER_S = 2381 * WEEK_S + 407_000.0
MOSCOW_S, DAY_S = 10_800, 86_400


def subframes(name: str) -> Iterator[tuple[int, int, int, list[int]]]:
    """System, satellite, signal and words of every RXM-SFRBX in a recording."""
    for frame in Framer().feed((ROOT / name).read_bytes()):
        if frame.protocol == "ubx" and frame.content[:2] == b"\x02\x13":
            message = frame.content[2:]
            words = [int.from_bytes(message[at : at + 4], "little") for at in range(8, len(message), 4)]
            yield message[0], message[1], message[2], words


def test_fnav_and_inav_of_a_satellite_hold_one_orbit() -> None:
    """The orbit of an issue is one and the same in both messages of Galileo; E19 was heard on E5a alone."""
    collectors: dict[int, InavCollector | FnavCollector] = {1: InavCollector(), 3: FnavCollector()}
    orbits: dict[tuple[int, int], dict[int, KeplerOrbit]] = {}
    for system, number, signal, words in subframes("boulder_4hz/rover.ubx"):
        if system != 2 or signal not in collectors:
            continue
        found = collectors[signal].add(number, words, BOULDER_S)
        if found is not None:
            assert isinstance(found.orbit, KeplerOrbit)
            orbits.setdefault((number, found.issue), {})[signal] = found.orbit
    both = [one for one in orbits.values() if len(one) == len(collectors)]
    assert len(both) >= 3
    assert all(one[1] == one[3] for one in both)


def glonass_message(ephemeris: Ephemeris) -> bytes:
    """Message 1020, field by field as in RTCM 10403.3; what RINEX does not hold is zero."""
    orbit = ephemeris.orbit
    assert isinstance(orbit, StateVectorOrbit)
    utc_s = unix_ns_from_gps(ephemeris.gps_week, ephemeris.toe_s) // NS
    frame_s = (ephemeris.t_ns // NS + MOSCOW_S) % DAY_S
    writer = BitWriter()
    for value, width in ((1020, 12), (int(ephemeris.satellite[1:]), 6), (orbit.frequency_channel + 7, 5), (0, 4)):
        writer.uint(value, width)
    for value, width in ((frame_s // 3600, 5), (frame_s // 60 % 60, 6), (frame_s // 30 % 2, 1)):
        writer.uint(value, width)
    for value, width in ((int(not ephemeris.healthy), 1), (0, 1), ((utc_s + MOSCOW_S) % DAY_S // 900, 7)):
        writer.uint(value, width)
    for axis in range(3):
        writer.magnitude(round(orbit.velocity_mps[axis] / 1000.0 * 2**20), 24)
        writer.magnitude(round(orbit.position_m[axis] / 1000.0 * 2**11), 27)
        writer.magnitude(round(orbit.acceleration_mps2[axis] / 1000.0 * 2**30), 5)
    writer.uint(0, 1)
    writer.magnitude(round(ephemeris.clock_drift * 2**40), 11)
    writer.uint(0, 3)
    writer.magnitude(round(-ephemeris.clock_bias_s * 2**30), 22)
    writer.uint(0, 107)
    assert writer.length == 360
    return writer.content()


def test_message_1020_holds_what_real_glonass_satellites_broadcast() -> None:
    """RINEX holds the broadcast steps to twelve digits, so that they are found again exactly."""
    navigation = read_navigation([ROOT / "berlin_5hz" / "nav_glo.16g"])
    # One station gave GPS time for UTC.
    assert ["17 s behind a quarter" in issue.text for issue in navigation.issues] == [True] * 6
    wanted = navigation.ephemerides
    assert len({one.satellite for one in wanted}) >= 20
    for one in wanted:
        message = glonass_message(one)
        found = read_ephemeris(1020, message, unix_ns_from_gps(one.gps_week, one.toe_s))
        assert isinstance(found.orbit, StateVectorOrbit)
        assert isinstance(one.orbit, StateVectorOrbit)
        assert (found.satellite, found.gps_week, found.toe_s, found.issue) == (
            one.satellite,
            one.gps_week,
            one.toe_s,
            one.issue,
        )
        assert (found.t_ns, found.healthy, found.orbit.frequency_channel) == (
            one.t_ns,
            one.healthy,
            one.orbit.frequency_channel,
        )
        # Half a unit of the twelfth digit: nanometres of clock, 0.1 mm of place, less than any step.
        assert found.clock_bias_s == pytest.approx(one.clock_bias_s, rel=1e-11)
        assert found.clock_drift == pytest.approx(one.clock_drift, rel=1e-11)
        for part in ("position_m", "velocity_mps", "acceleration_mps2"):
            assert getattr(found.orbit, part) == pytest.approx(getattr(one.orbit, part), rel=1e-11), part
        # Our own writer makes the same bits.
        assert write_ephemeris(one) == message
