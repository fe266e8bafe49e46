"""The processes of the bridge benchmark: bridges, and a speaker that says what they must keep."""

from __future__ import annotations

import asyncio
import mmap
import struct
import time
from multiprocessing.connection import Connection
from pathlib import Path

import msgspec

from schemas.bridge import BridgedRecord
from schemas.codec import encode
from schemas.radio import RadioMeasurement
from schemas.topic import Place
from schemas.topics import RADIO_MEASUREMENT
from services.lte_bridge.service import SERVICE, Config
from services.runtime.attachment import Attachment, encode_attachment
from services.runtime.clock import LiveClock
from services.runtime.guest import guest
from services.runtime.host_config import BusConfig
from services.runtime.zenoh_node import ZenohNode

TRAIN, CLOUD = Place("bench", "train", "T1"), Place("bench", "cloud", "C1")
SPOKEN = 16
"""Devices that speak in turn."""


def measurement(number: int) -> RadioMeasurement:
    """A measurement as a train's radio makes it; no two alike."""
    return RadioMeasurement(
        t_ns=1_700_000_000_000_000_000 + 5_000_017 * number,
        radio=f"R{number % 5}",
        channel="ch1",
        channel_power_dbm=-60.0 - (number * 0.618034) % 23.0,
        decoded_power_dbm=-62.0 - (number * 0.414214) % 19.0,
        received_ratio=(number * 0.71) % 1.0,
        chainage_m=0.1 * number,
        pass_id="bench",
    )


def records(first: int, count: int) -> list[BridgedRecord]:
    """What a bridge hears of sixteen radios."""
    return [
        BridgedRecord(
            key=RADIO_MEASUREMENT.at(TRAIN, device=f"r{number % SPOKEN}"),
            payload=encode(measurement(number)),
            attachment=encode_attachment(Attachment("bench/train/T1/probe", "boot", number // SPOKEN, number)),
            heard_ns=1_700_000_000_000_000_000 + number,
        )
        for number in range(first, first + count)
    ]


def bridge(pipe: Connection, place: Place, router: str, settings: dict[str, object]) -> None:
    """Run a bridge until told to end."""

    async def live() -> None:
        node = await ZenohNode.open(SERVICE, place, SERVICE.name, LiveClock(), BusConfig(connect=(router,)))
        running = asyncio.ensure_future(SERVICE.run(node, msgspec.convert(settings, Config)))
        try:
            await node.wait_ready()
            pipe.send(time.monotonic())
            await asyncio.to_thread(pipe.recv)
            node.stop()
            await running
        finally:
            await node.close()

    asyncio.run(live())


def speak(pipe: Connection, router: str, count: int) -> None:
    """Publish measurements as fast as the bus takes them."""

    async def live() -> None:
        service = guest("probe", "speaks for the benchmark", writes=(RADIO_MEASUREMENT,))
        node = await ZenohNode.open(service, TRAIN, service.name, LiveClock(), BusConfig(connect=(router,)))
        try:
            messages = [measurement(number) for number in range(count)]
            began_s = time.monotonic()
            for number, message in enumerate(messages):
                await node.publish(RADIO_MEASUREMENT, message, device=f"r{number % SPOKEN}")
            pipe.send(began_s)
            await asyncio.to_thread(pipe.recv)
        finally:
            await node.close()

    asyncio.run(live())


def speak_steadily(pipe: Connection, router: str, rate_hz: float, path: str) -> None:
    """Publish at a rate until killed; number and time [ns] of the last one stand in a file that outlives this."""

    async def live(said: mmap.mmap) -> None:
        service = guest("probe", "speaks for the benchmark", writes=(RADIO_MEASUREMENT,))
        node = await ZenohNode.open(service, TRAIN, service.name, LiveClock(), BusConfig(connect=(router,)))
        pipe.send("speaks")
        number = 0
        began_s = time.monotonic()
        while True:
            while number < rate_hz * (time.monotonic() - began_s):
                await node.publish(RADIO_MEASUREMENT, measurement(number), device="r0")
                said[:] = struct.pack("<qq", number, time.time_ns())
                number += 1
            await asyncio.sleep(0.001)

    with Path(path).open("r+b") as file, mmap.mmap(file.fileno(), 16) as said:
        asyncio.run(live(said))
