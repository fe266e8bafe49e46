"""The reference station's service: its place, what it publishes, what it gives as RTCM 3."""

from __future__ import annotations

import asyncio
import socket
from math import radians
from pathlib import Path

import pytest

from schemas.gnss import Corrections, Ephemeris, Epoch
from schemas.topic import Place
from schemas.topics import GNSS_CORRECTION, GNSS_EPHEMERIS
from services.gnss_receiver.heard import StationPosition
from services.gnss_receiver.reception import FileSource
from services.gnss_receiver.rinex_error import RinexError
from services.gnss_receiver.rtcm_ephemerides import read_ephemeris, write_ephemeris
from services.gnss_receiver.rtcm_messages import framed, number_of
from services.gnss_receiver.rtcm_msm_writing import MsmWriter
from services.gnss_receiver.rtcm_station import write_station
from services.gnss_receiver.service import SERVICE as RECEIVER
from services.gnss_reference.service import SERVICE, Config, RtcmOut
from services.gnss_reference.station_place import StationPlace
from services.numerics.geodesy import ecef_from_geodetic
from services.runtime.clock import ManualClock
from services.runtime.guest import guest
from services.runtime.manual_loop import run_manual
from services.runtime.memory_node import MemoryBus, MemoryNode
from tests.unit.gnss_correction.made_up_sky import PLACE_DEG, PLACE_M, START_S, constellation, measured
from tests.unit.gnss_receiver.stream_samples import listen

DEPOT = Place("demo", "wayside", "depot")
LIMIT_S = 5.0
"""Longest wait for anything; reached only when a test fails."""
DAY = "2024-02-06"
"""The made-up week 2300 begins on 2024-02-04; START_S is on Tuesday."""
NEAR_NS = 1_707_220_800 * 10**9
PLACE = (float(PLACE_M[0]), float(PLACE_M[1]), float(PLACE_M[2]))
READER = guest("reader", "listens", reads=(GNSS_CORRECTION,))


def sky() -> list[Ephemeris]:
    """What becomes of made-up ephemerides in messages."""
    messages = [write_ephemeris(one) for one in constellation()]
    return [read_ephemeris(number_of(one), one, NEAR_NS) for one in messages]


SKY = sky()
BROADCAST = b"".join(framed(write_ephemeris(one)) for one in SKY)
EPOCHS = [measured(SKY, START_S + second) for second in range(8)]


def frames(epochs: list[Epoch]) -> list[bytes]:
    writer = MsmWriter(5)
    return [b"".join(framed(message) for message in writer.messages(one, {})) for one in epochs]


def station(position_m: tuple[float, float, float]) -> bytes:
    return framed(write_station(StationPosition(5, position_m)))


def moved(by_m: float) -> tuple[float, float, float]:
    return PLACE[0] + by_m, PLACE[1], PLACE[2]


def play(
    folder: Path, stream: bytes, position: tuple[float, float, float] | None = None
) -> tuple[list[Corrections], MemoryNode]:
    path = folder / "base.rtcm3"
    path.write_bytes(stream)

    async def main() -> tuple[list[Corrections], MemoryNode]:
        clock = ManualClock(asyncio.get_running_loop(), NEAR_NS)
        bus = MemoryBus()
        reader, node = MemoryNode(bus, READER, DEPOT, clock), MemoryNode(bus, SERVICE, DEPOT, clock)
        messages = reader.messages(GNSS_CORRECTION)
        source = FileSource(path=str(path), recorded=DAY)
        await node.run(Config(file=source, position=position, speed=0.0))
        reader.stop()
        return [one async for one in messages], node

    return run_manual(main())


def test_a_station_corrects_what_it_sees(tmp_path: Path) -> None:
    published, node = play(tmp_path, BROADCAST + b"".join(frames(EPOCHS)), PLACE_DEG)
    assert len(published) == len(EPOCHS)
    last = published[-1]
    assert (last.station, last.gps_week, last.tow_s) == ("depot", 2300, START_S + 7)
    assert (last.lat_deg, last.lon_deg, last.h_m) == PLACE_DEG
    assert {one.satellite for one in last.satellites} <= {one.satellite for one in SKY}
    assert len(last.satellites) >= 6
    for one in last.satellites:
        assert one.issue == 7
        # Nothing but the air is wrong in the made-up sky: between 2 m at the zenith and some 20 m at 6 degrees.
        assert -25.0 < one.correction_m < 5.0
    assert node.health.level(0.0) == ("ok", ())


def test_the_place_may_come_from_the_stream(tmp_path: Path) -> None:
    first, *others = frames(EPOCHS)
    published, node = play(tmp_path, BROADCAST + first + station(PLACE) + b"".join(others))
    assert len(published) == len(EPOCHS) - 1
    assert published[0].lat_deg == pytest.approx(PLACE_DEG[0], abs=1e-9)
    assert published[0].h_m == pytest.approx(PLACE_DEG[2], abs=1e-3)
    assert node.health.counts["epochs_refused"] == 1
    assert node.health.level(0.0) == ("ok", ())


def test_without_a_place_there_is_nothing(tmp_path: Path) -> None:
    published, node = play(tmp_path, BROADCAST + station((0.0, 0.0, 0.0)) + b"".join(frames(EPOCHS)))
    assert published == []
    words = "no position: configure one, or send RTCM 1005 or 1006; no corrections are given"
    assert node.health.level(0.0) == ("failed", (words,))


def test_a_station_that_says_it_moved_gives_nothing(tmp_path: Path) -> None:
    before, after = frames(EPOCHS[:3]), frames(EPOCHS[3:])
    stream = station(PLACE) + BROADCAST + b"".join(before) + station(moved(100.0)) + b"".join(after)
    published, node = play(tmp_path, stream)
    assert len(published) == 3
    words = "the station says that it stands 100.0 m from where it was; no corrections are given"
    assert node.health.level(0.0) == ("failed", (words,))
    published, node = play(tmp_path, stream + station(moved(4.0)) + b"".join(frames([measured(SKY, START_S + 9)])))
    assert len(published) == 4
    assert node.health.level(0.0) == ("ok", ())


def test_a_station_whose_measurements_moved_gives_nothing(tmp_path: Path) -> None:
    lat, lon, h = PLACE_DEG
    published, node = play(tmp_path, BROADCAST + b"".join(frames(EPOCHS)), (lat + 0.001, lon, h))
    assert [one.satellites for one in published] == [()] * len(EPOCHS)
    level, (reason,) = node.health.level(0.0)
    assert level == "failed"
    # A thousandth of a degree is 111 m.
    assert reason == "no satellite is corrected: the station seems to stand 111 m off"


def test_places_are_held_against_each_other() -> None:
    configured = StationPlace(PLACE_DEG)
    assert configured.position_m == pytest.approx(PLACE)
    configured.hear(StationPosition(1, moved(5.1)))
    assert configured.fault == "the station says that it stands 5.1 m from where it is configured"
    configured.hear(StationPosition(1, moved(4.9)))
    assert configured.fault == ""
    unknown = StationPlace(None)
    unknown.hear(StationPosition(1, (1e9, 0.0, 0.0)))
    assert unknown.position_deg is None
    unknown.hear(StationPosition(1, PLACE))
    assert unknown.position_m == pytest.approx(PLACE, abs=1e-6)
    x, y, z = ecef_from_geodetic(radians(PLACE_DEG[0]), radians(PLACE_DEG[1]), PLACE_DEG[2])
    assert (x, y, z) == pytest.approx(PLACE)


def test_observations_are_given_as_rtcm(tmp_path: Path) -> None:
    path = tmp_path / "base.rtcm3"
    path.write_bytes(BROADCAST + b"".join(frames(EPOCHS)))

    async def main() -> bytes:
        clock = ManualClock(asyncio.get_running_loop(), NEAR_NS)
        node = MemoryNode(MemoryBus(), SERVICE, DEPOT, clock)
        source = FileSource(path=str(path), recorded=DAY)
        config = Config(file=source, position=PLACE_DEG, rtcm=RtcmOut(port=0, station=77))
        running = asyncio.ensure_future(node.run(config))
        await node.is_ready.wait()
        client = socket.create_connection(("127.0.0.1", node.health.counts["rtcm_port"]), LIMIT_S)
        await running
        received = b""
        while part := client.recv(65_536):
            received += part
        client.close()
        return received

    heard, receiver = listen(run_manual(main()), near_ns=NEAR_NS)
    assert receiver.counts["bytes_skipped"] == 0
    epochs = [one for one in heard if isinstance(one, Epoch)]
    assert len(epochs) >= len(EPOCHS) - 1
    wanted = {one.tow_s: one for one in EPOCHS}
    for one in epochs:
        assert sorted(one.satellites) == sorted(wanted[one.tow_s].satellites)
    places = [one for one in heard if isinstance(one, StationPosition)]
    assert places
    assert {one.station for one in places} == {77}
    assert places[0].position_m == pytest.approx(PLACE, abs=1e-4)
    assert sorted(one.satellite for one in heard if isinstance(one, Ephemeris)) == sorted(one.satellite for one in SKY)


def test_ephemerides_come_from_trains_where_the_base_sends_none(tmp_path: Path) -> None:
    path = tmp_path / "base.rtcm3"
    path.write_bytes(b"".join(frames(EPOCHS)))

    async def main() -> tuple[list[Corrections], dict[str, int]]:
        clock = ManualClock(asyncio.get_running_loop(), NEAR_NS)
        bus = MemoryBus()
        train = MemoryNode(bus, RECEIVER, Place("demo", "train", "T1"), clock)
        reader, node = MemoryNode(bus, READER, DEPOT, clock), MemoryNode(bus, SERVICE, DEPOT, clock)
        messages = reader.messages(GNSS_CORRECTION)
        for one in SKY:
            await train.publish(GNSS_EPHEMERIS, one, device="front", satellite=one.satellite)
        await node.run(Config(file=FileSource(path=str(path), recorded=DAY), position=PLACE_DEG))
        reader.stop()
        return [one async for one in messages], node.health.counts

    published, counts = run_manual(main())
    assert counts["ephemerides_from_trains"] == len(SKY)
    assert len(published[-1].satellites) >= 6


def test_a_recording_that_cannot_be_read_ends_the_service(tmp_path: Path) -> None:
    with pytest.raises(RinexError, match="holds no RTCM 3, UBX or NMEA"):
        play(tmp_path, b"nothing", PLACE_DEG)
