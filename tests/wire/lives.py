"""Services that live and die in ways that tests want: `python -m tests.wire.lives NAME PROFILE`.

`beat` works, `raises` fails once it is ready, `stuck` blocks its event loop, `stubborn`
does not finish when asked, `slow` is never ready, `done` has nothing to do.
"""

from __future__ import annotations

import asyncio
import os
import sys
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import structlog

from schemas.position import TrainTruth
from schemas.topics import TRAIN_TRUTH
from services.runtime.config import load_host
from services.runtime.host_config import Settings
from services.runtime.main import run_service
from services.runtime.node import Node, Service

PERIOD_S = 0.05


class NoConfig(Settings, frozen=True, kw_only=True):
    """Nothing to set."""


async def _beat(node: Node, config: NoConfig) -> None:
    del config
    node.ready()
    while await node.sleep(PERIOD_S):
        t_ns = node.clock.now_ns()
        truth = TrainTruth(
            t_ns=t_ns, lat_deg=35, lon_deg=135, h_m=0, ve_mps=0, vn_mps=0, vu_mps=0, axis_m=0, speed_mps=0
        )
        await node.publish(TRAIN_TRUTH, truth, device="front")


async def _raises(node: Node, config: NoConfig) -> None:
    del config
    node.ready()
    await node.sleep(PERIOD_S)
    msg = "the balise reader answers nonsense"
    raise ValueError(msg)


async def _stuck(node: Node, config: NoConfig) -> None:
    del config
    node.ready()
    await node.sleep(5 * PERIOD_S)
    structlog.get_logger().info("about_to_block")
    while True:
        time.sleep(0.01)  # noqa: ASYNC251 - the fault that is to be noticed


async def _stubborn(node: Node, config: NoConfig) -> None:
    del config
    node.ready()
    while True:
        try:
            await asyncio.sleep(60)
        except asyncio.CancelledError:  # the fault: it goes on
            await node.sleep(0)


async def _slow(node: Node, config: NoConfig) -> None:
    del config
    while await node.sleep(60):
        pass


async def _done(node: Node, config: NoConfig) -> None:
    del node, config


RUNS: dict[str, Callable[[Node, NoConfig], Awaitable[None]]] = {
    "beat": _beat,
    "raises": _raises,
    "stuck": _stuck,
    "stubborn": _stubborn,
    "slow": _slow,
    "done": _done,
}


if __name__ == "__main__":
    name = sys.argv[1]
    SERVICE = Service(name, NoConfig, (), (TRAIN_TRUTH,), RUNS[name], f"a service that {name}")
    run_service(lambda: SERVICE, load_host(Path(sys.argv[2]), os.environ), name)
