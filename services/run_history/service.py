"""Legs of this train from its positions: running time and traction energy as kept records."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import msgspec

from schemas.topics import RUN_RECORD, TRAIN_POSITION
from services.line.alignment import alignment_of, routes
from services.line.line_file import load_line
from services.run_history.demo_vehicle import DEMO, demo_vehicle
from services.run_history.live_runs import Arrival, LiveRuns
from services.run_history.vehicle_file import read_vehicle
from services.runtime.node import Node, Service


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the run history."""

    line_file: str = "demo"
    """Line file, or the name of a line that comes with Kirotei."""
    vehicle_file: str = DEMO
    """Vehicle file (docs/run_history.md); `demo`: an assumed train, whose energies only compare runs."""


def _load(config: Config) -> LiveRuns:
    line = load_line(Path(config.line_file)).line
    vehicle = demo_vehicle() if config.vehicle_file == DEMO else read_vehicle(Path(config.vehicle_file))
    return LiveRuns(line, [alignment_of(line, branch) for branch in routes(line)], vehicle)


async def run(node: Node, config: Config) -> None:
    """Cut legs until asked to stop. Raises what is wrong with the files.

    Nothing is kept over a restart: the leg under way then is told as cut when its station is reached.
    """
    positions = node.messages(TRAIN_POSITION)
    live = await node.in_thread(lambda: _load(config))
    node.ready()
    async for position in positions:
        taken = live.take(position)
        found = await node.in_thread(partial(live.record, taken)) if isinstance(taken, Arrival) else taken
        node.health.counts["ignored"] = live.ignored
        if found is not None:
            node.health.count("cut" if found.running_time_s is None else "legs")
            await node.publish(RUN_RECORD, found)


SERVICE = Service(
    "run_history",
    Config,
    reads=(TRAIN_POSITION,),
    writes=(RUN_RECORD,),
    run=run,
    about="running time and traction energy of every leg from station to station, from the train's positions",
)
