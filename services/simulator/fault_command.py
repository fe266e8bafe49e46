"""`kirotei fault` on the bus: says it until the simulator is there to hear it."""

from __future__ import annotations

import sys
from typing import NoReturn

import msgspec

from schemas.position import SimulatorFault
from schemas.topic import Place
from schemas.topics import SIMULATOR_FAULT
from services.recorder.bus_session_command import BusSession
from services.runtime.zenoh_node import ZenohNode

LINGER_S = 1.0
"""A subscriber that is told of us only now gets the event from our cache within this."""


def run_fault(message: SimulatorFault, place: Place, endpoint: str) -> NoReturn:
    """Publish the fault and end the process."""

    async def work(node: ZenohNode) -> int:
        await node.publish(SIMULATOR_FAULT, msgspec.structs.replace(message, t_ns=node.clock.now_ns()))
        await node.sleep(LINGER_S)
        sys.stdout.write(f"{message.kind} switched {'on' if message.active else 'off'} in {place}\n")
        return 0

    BusSession("fault", place, endpoint, work, speaks=True).run()
