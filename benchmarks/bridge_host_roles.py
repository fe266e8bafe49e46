"""What runs on the hosts: `speak LISTEN EVENTS_HZ BULK_HZ` on the train, `listen LISTEN` in the cloud.

Each is the router of its host as well, prints one JSON value per line, and ends when its
standard input does.
"""

from __future__ import annotations

import asyncio
import sys
import time

from benchmarks.host_processes import end_of_input, say
from schemas.health import ServiceEvent
from schemas.radio import Weather
from schemas.topic import Place
from schemas.topics import SERVICE_EVENT, WEATHER
from services.runtime.clock import LiveClock
from services.runtime.guest import guest
from services.runtime.host_config import BusConfig, RouterConfig
from services.runtime.router import open_router
from services.runtime.zenoh_node import ZenohNode

TRAIN, CLOUD = Place("demo", "train", "T1"), Place("demo", "cloud", "C1")
PATIENCE_S = 45.0
SUBSCRIBED_S = 2.0
"""After its token stands a bridge has opened its spool and subscribed within this."""


async def speak(router: str, events_hz: float, bulk_hz: float) -> None:
    """Events and bulk, each numbered and stamped when it is said; in the end how many."""
    service = guest("speaker", "speaks", writes=(SERVICE_EVENT, WEATHER))
    node = await ZenohNode.open(service, TRAIN, "speaker", LiveClock(), BusConfig(connect=(router,)))
    # What is said before the bridge has subscribed may be missed: that is no matter of the link.
    bridge = f"{TRAIN}/lte_bridge"
    until_s = time.monotonic() + PATIENCE_S
    while bridge not in await node.services_alive(TRAIN.line) and time.monotonic() < until_s:  # noqa: ASYNC110 - it asks
        await asyncio.sleep(0.2)
    await asyncio.sleep(SUBSCRIBED_S)
    counts = {"events": 0, "bulk": 0}

    async def events() -> None:
        while True:
            text = str(counts["events"])
            message = ServiceEvent(t_ns=time.time_ns(), service="s", boot_id="b", kind="level", text=text)
            await node.publish(SERVICE_EVENT, message, service="speaker")
            counts["events"] += 1
            await asyncio.sleep(1.0 / events_hz)

    async def bulk() -> None:
        while True:
            await node.publish(WEATHER, Weather(t_ns=time.time_ns(), axis_m=float(counts["bulk"])))
            counts["bulk"] += 1
            await asyncio.sleep(1.0 / bulk_hz)

    tasks = [asyncio.create_task(events()), asyncio.create_task(bulk())]
    say("ready")
    await end_of_input()
    for task in tasks:
        task.cancel()
    await asyncio.wait(tasks)
    say(counts)
    await end_of_router(node)


async def listen(router: str) -> None:
    """What comes over the bridge, as [kind, number, seconds since it was said]."""
    service = guest("listener", "listens", reads=(SERVICE_EVENT, WEATHER))
    node = await ZenohNode.open(service, CLOUD, "listener", LiveClock(), BusConfig(connect=(router,)))

    async def hear() -> None:
        async for arrival in node.arrivals(SERVICE_EVENT, WEATHER, mirrored=True):
            if not arrival.source.endswith("/speaker"):
                continue
            message = arrival.message
            age_s = (time.time_ns() - message.t_ns) / 1e9
            if isinstance(message, ServiceEvent):
                say(["events", int(message.text), age_s])
            else:
                say(["bulk", int(message.axis_m), age_s])

    hearing = asyncio.create_task(hear())
    say("ready")
    await end_of_input()
    hearing.cancel()
    await end_of_router(node)


async def end_of_router(node: ZenohNode) -> None:
    """Close, once what was said last has reached whoever lives on after this host."""
    await asyncio.sleep(0.5)
    await node.close()


def main() -> None:
    """Play the role that the arguments name."""
    role, endpoint, *rates = sys.argv[1:]
    inside = "tcp/127.0.0.1:7447"
    with open_router(RouterConfig(listen=(endpoint, inside) if endpoint != inside else (inside,))):
        asyncio.run(speak(inside, *map(float, rates)) if role == "speak" else listen(inside))


if __name__ == "__main__":
    main()
