"""What runs on the hosts: `router LISTEN [CONNECT]`, `write ROUTER`, `read ROUTER`.

Each ends when its standard input does, and prints one JSON value per line.
"""

from __future__ import annotations

import asyncio
import sys

from benchmarks.host_processes import end_of_input, say
from schemas.gnss import Fix
from schemas.health import ServiceEvent
from schemas.message import Message
from schemas.position import TrainTruth
from schemas.topic import Place, Topic
from schemas.topics import GNSS_FIX, SERVICE_EVENT, TRAIN_TRUTH
from services.runtime.clock import LiveClock
from services.runtime.guest import guest
from services.runtime.host_config import BusConfig, RouterConfig
from services.runtime.router import open_router
from services.runtime.zenoh_node import ZenohNode

PERIOD_S = 0.02
"""Fifty of each a second: an outage of some seconds stays well within what is kept of events."""
TOPICS: tuple[Topic[Message], ...] = (TRAIN_TRUTH, GNSS_FIX, SERVICE_EVENT)


async def route(listen: str, connect: tuple[str, ...]) -> None:
    with open_router(RouterConfig(listen=(listen,), connect=connect)):
        say("ready")
        await end_of_input()


async def write(router: str) -> None:
    place = Place("demo", "train", "T1")
    service = guest("writer", "writes until told to end", writes=TOPICS)
    node = await ZenohNode.open(service, place, "writer", LiveClock(), BusConfig(connect=(router,)))
    ended = asyncio.create_task(end_of_input())
    number = 0
    while not ended.done():
        await node.publish(
            TRAIN_TRUTH,
            TrainTruth(
                t_ns=number, lat_deg=35, lon_deg=135, h_m=0, ve_mps=0, vn_mps=0, vu_mps=0, axis_m=0, speed_mps=0
            ),
            device="front",
        )
        await node.publish(
            GNSS_FIX,
            Fix(
                t_ns=number,
                gps_week=2400,
                tow_s=0,
                method="original",
                status="none",
                satellites_used=0,
                satellites_flagged=0,
            ),
            device="front",
        )
        await node.publish(
            SERVICE_EVENT,
            ServiceEvent(t_ns=number, service="writer", boot_id=node.boot_id, kind="level", text=""),
            service="writer",
        )
        number += 1
        await asyncio.sleep(PERIOD_S)
    say(number)
    await asyncio.sleep(1.0)  # the last ones on their way, and the heartbeat that tells of them
    await node.close()


async def read(router: str) -> None:
    place = Place("demo", "cloud", "main")
    service = guest("reader", "reads until told to end", reads=TOPICS)
    node = await ZenohNode.open(service, place, "reader", LiveClock(), BusConfig(connect=(router,)))
    ended = asyncio.create_task(end_of_input())
    ended.add_done_callback(lambda _: node.stop())
    arrivals = node.arrivals(*TOPICS, anywhere=True)
    say("ready")
    async for arrival in arrivals:
        say([arrival.key.split("/")[5], arrival.sequence])
    inputs = node.health.report(0, node.clock.monotonic_s()).inputs
    say({entry.key.split("/")[5]: [entry.missing, entry.duplicated] for entry in inputs})
    await node.close()


def main() -> None:
    role, *arguments = sys.argv[1:]
    if role == "router":
        asyncio.run(route(arguments[0], tuple(arguments[1:])))
    elif role == "write":
        asyncio.run(write(arguments[0]))
    else:
        asyncio.run(read(arguments[0]))


if __name__ == "__main__":
    main()
