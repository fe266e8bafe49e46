"""`kirotei fault` on the bus: says it to a simulator that is there to hear it."""

from __future__ import annotations

import sys
from typing import Final, NoReturn

import msgspec

from schemas.position import SimulatorFault
from schemas.topic import Place
from schemas.topics import SIMULATOR_FAULT
from services.recorder.bus_session_command import BusSession
from services.runtime.zenoh_node import ZenohNode

LINGER_S: Final = 1.0
"""A subscriber that is told of us only now gets the event from our cache within this."""
ASKED: Final = 3
"""So often we ask who is there, LINGER_S apart: a token may be on its way."""
SIMULATOR: Final = "/simulator"


def run_fault(message: SimulatorFault, place: Place, endpoint: str) -> NoReturn:
    """Publish the fault and end the process; exit code 1 when no simulator is there."""

    async def work(node: ZenohNode) -> int:
        for _ in range(ASKED):
            alive = await node.services_alive(place.line)
            if any(one.startswith(f"{place}{SIMULATOR}") for one in alive):
                break
            await node.sleep(LINGER_S)
        else:
            sys.stderr.write(f"kirotei fault: {nobody_there(place, alive)}\n")
            return 1
        await node.publish(SIMULATOR_FAULT, msgspec.structs.replace(message, t_ns=node.clock.now_ns()))
        await node.sleep(LINGER_S)
        sys.stdout.write(f"{message.kind} switched {'on' if message.active else 'off'} in {place}\n")
        return 0

    BusSession("fault", place, endpoint, work, speaks=True).run()


def nobody_there(place: Place, alive: set[str]) -> str:
    """Why nobody would hear a fault, of the services that live on the line.

    >>> nobody_there(Place("demo", "train", "T9"), {"demo/train/T1/simulator", "demo/train/T1/train_position"})
    'no simulator of demo/train/T9 is running; there are: T1 (--train, --line)'
    """
    trains = sorted({one.split("/")[2] for one in alive if SIMULATOR in one})
    there = f"there are: {', '.join(trains)}" if trains else f"none is on line {place.line}"
    return f"no simulator of {place} is running; {there} (--train, --line)"
