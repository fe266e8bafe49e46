"""A reference station on the bus: corrections of every satellite, and its observations as RTCM 3 where wanted."""

from __future__ import annotations

import asyncio
from collections import Counter
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from schemas.gnss import Corrections, Ephemeris, Epoch, Ionosphere, OwnPosition
from schemas.topics import GNSS_CORRECTION, GNSS_EPHEMERIS
from services.gnss_correction.pipeline import block_of, silent_epoch
from services.gnss_receiver.heard import StationPosition
from services.gnss_receiver.reception import Reception
from services.gnss_receiver.reception_stream import receive
from services.gnss_reference.reference_correction import ReferenceStation, StationSettings
from services.gnss_reference.rtcm_output import RtcmOutput
from services.gnss_reference.station_place import StationPlace
from services.nmea_output.outlet_socket import Outlet
from services.runtime.node import Node, Service

Latitude = Annotated[float, Meta(ge=-90.0, le=90.0)]
Longitude = Annotated[float, Meta(ge=-180.0, le=180.0)]
Height = Annotated[float, Meta(ge=-1_000.0, le=10_000.0)]


class RtcmOut(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The station's observations as RTCM 3 over TCP: MSM, ephemerides, 1005."""

    port: Annotated[int, Meta(ge=0, le=65_535)]
    """Port to listen on; 0 takes a free one, which health tells."""
    host: str = "127.0.0.1"
    """Address to listen on; 0.0.0.0 for every network of the host. Whoever connects is served."""
    station: Annotated[int, Meta(ge=0, le=4095)] = 0
    """Number of the station in the messages."""
    msm: Literal[4, 7] = 7
    """7 has rates and finer figures, 4 is shorter."""


class Config(Reception, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of a reference station; its receiver is read as `gnss_receiver` reads one."""

    name: str = ""
    """Name of the station in its corrections; empty for the place's own."""
    position: tuple[Latitude, Longitude, Height] | None = None
    """Antenna: latitude, longitude [deg], ellipsoidal height [m] (WGS 84). Without it, where RTCM 1005 or 1006 says."""
    corrections: StationSettings = StationSettings()
    """How corrections are made."""
    rtcm: RtcmOut | None = None
    """Give the observations as RTCM 3, too."""


async def run(node: Node, config: Config) -> None:
    """Correct until the recording ends or the service is to stop; raises what `receive` raises, and OSError."""
    await node.in_thread(_warm_up)
    outlet = None if config.rtcm is None else Outlet(config.rtcm.host, config.rtcm.port)
    station = _Station(node, config, outlet)
    try:
        async with asyncio.TaskGroup() as group:
            listening = group.create_task(_hear_trains(node, station))
            await _hear_receiver(node, config, station)
            listening.cancel()
    except ExceptionGroup as failed:
        # What ends the service is told as it is, whichever of the two met it.
        raise failed.exceptions[0] from failed
    finally:
        if outlet is not None:
            outlet.close()


def _warm_up() -> None:
    """Compile the kernels, or load them from their cache, before the first epoch waits for them."""
    for _ in ReferenceStation("", (0.0, 0.0, 0.0), StationSettings()).block(block_of(silent_epoch())):
        pass


async def _hear_receiver(node: Node, config: Config, station: _Station) -> None:
    async for heard in receive(node, config):
        match heard:
            case Epoch():
                await station.epoch(heard)
            case Ephemeris() | Ionosphere():
                station.broadcast(heard)
            case StationPosition():
                station.place.hear(heard)
            case OwnPosition():
                # A receiver's own idea of its position is no survey.
                node.health.count("own_positions_unused")


async def _hear_trains(node: Node, station: _Station) -> None:
    """Take ephemerides from the trains, too: many base stations send none, and the sky is the same."""
    async for arrival in node.arrivals(GNSS_EPHEMERIS, anywhere=True):
        node.health.count("ephemerides_from_trains")
        station.broadcast(arrival.message)


class _Station:
    """What the service keeps between messages."""

    def __init__(self, node: Node, config: Config, outlet: Outlet | None) -> None:
        self._node = node
        self._config = config
        self._outlet = outlet
        self._counts: Counter[str] = Counter()
        self._rtcm = None if config.rtcm is None else RtcmOutput(config.rtcm.station, config.rtcm.msm, self._counts)
        self._heard: dict[str, Ephemeris | Ionosphere] = {}
        self._station: ReferenceStation | None = None
        self.place = StationPlace(config.position)
        if outlet is not None:
            node.health.counts["rtcm_port"] = outlet.port

    def broadcast(self, heard: Ephemeris | Ionosphere) -> None:
        """Take in what a satellite broadcast, also before the place is known."""
        self._heard[heard.satellite if isinstance(heard, Ephemeris) else ""] = heard
        if self._station is not None:
            self._station.add(heard)
        if self._rtcm is not None and self._outlet is not None and isinstance(heard, Ephemeris):
            frame = self._rtcm.ephemeris(heard)
            if self.place.position_m is not None:
                self._outlet.send(frame)

    async def epoch(self, epoch: Epoch) -> None:
        """Publish what an epoch gives, unless the place is not to be trusted."""
        node = self._node
        node.health.counts.update(self._counts)
        position_deg, position_m = self.place.position_deg, self.place.position_m
        fault = self.place.fault or ("" if position_deg else "no position: configure one, or send RTCM 1005 or 1006")
        if fault or position_deg is None or position_m is None:
            node.health.set("place", f"{fault}; no corrections are given", "failed")
            node.health.count("epochs_refused")
            return
        node.health.clear("place")
        self._send(epoch, position_m)
        if self._station is None:
            name = self._config.name or node.place.name
            self._station = ReferenceStation(name, position_deg, self._config.corrections, in_turns=True)
            for heard in self._heard.values():
                self._station.add(heard)
        for corrections in self._station.block(block_of(epoch)):
            self._report(corrections)
            await node.publish(GNSS_CORRECTION, corrections)

    def _send(self, epoch: Epoch, position_m: tuple[float, float, float]) -> None:
        if self._rtcm is None or self._outlet is None:
            return
        self._outlet.greet(self._rtcm.greeting(position_m))
        self._outlet.send(self._rtcm.epoch(epoch, position_m))
        self._node.health.counts["rtcm_clients"] = self._outlet.clients

    def _report(self, corrections: Corrections) -> None:
        """Say in health when a station that measures corrects nothing, and why."""
        health = self._node.health
        health.count("corrections")
        health.counts["satellites_corrected"] = len(corrections.satellites)
        health.counts["satellites_refused"] = len(corrections.refused)
        if corrections.satellites:
            health.clear("corrections")
            return
        reasons = Counter(one.reason for one in corrections.refused).most_common(1)
        health.set(
            "corrections", f"no satellite is corrected: {reasons[0][0] if reasons else 'none is seen'}", "failed"
        )


SERVICE = Service(
    "gnss_reference",
    Config,
    reads=(GNSS_EPHEMERIS,),
    writes=(GNSS_CORRECTION,),
    run=run,
    about="a GNSS receiver at a known place beside the line: what is wrong with every satellite's pseudorange there",
)
