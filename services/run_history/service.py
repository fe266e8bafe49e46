"""Legs of this train from its positions: running time and traction energy as kept records."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

import msgspec

from schemas.runs import RunRecord
from schemas.topics import RUN_RECORD, TRAIN_POSITION
from services.line.alignment import alignment_of, routes
from services.line.line_file import load_line
from services.run_history.demo_vehicle import DEMO, demo_vehicle
from services.run_history.leg_journal_store import JournalError, add_place, begin_journal, journal_file, read_journal
from services.run_history.live_runs import Arrival, LiveRuns
from services.run_history.vehicle_file import read_vehicle
from services.runtime.clock import LiveClock
from services.runtime.node import Node, Service
from services.runtime.state_dir import state_dir


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the run history."""

    line_file: str = "demo"
    """Line file, or the name of a line that comes with Kirotei."""
    vehicle_file: str = DEMO
    """Vehicle file (docs/run_history.md); `demo`: an assumed train, whose energies only compare runs."""
    state: bool = True
    """Whether the leg under way is kept on disk, so that a restart goes on with it."""
    state_folder: str = ""
    """Folder for it; by default the host's state folder."""


def _load(config: Config) -> LiveRuns:
    line = load_line(Path(config.line_file)).line
    vehicle = demo_vehicle() if config.vehicle_file == DEMO else read_vehicle(Path(config.vehicle_file))
    return LiveRuns(line, [alignment_of(line, branch) for branch in routes(line)], vehicle)


async def run(node: Node, config: Config) -> None:
    """Cut legs until asked to stop. Raises what is wrong with the files.

    The journal is begun anew only after a record has been published: a restart between the two tells the same record
    with the same bytes once more, and loses none.
    """
    positions = node.messages(TRAIN_POSITION)
    live = await node.in_thread(lambda: _load(config))
    path = _journal_path(node, config)
    if path is not None:
        for untold in await node.in_thread(partial(_resumed, node, live, path)):
            await _tell(node, live, untold)
        await _keep(node, partial(begin_journal, path, *live.begun()))
    node.ready()
    async for position in positions:
        count = len(live.kept)
        found = live.take(position)
        node.health.counts["ignored"] = live.ignored
        if found is not None:
            await _tell(node, live, found)
        if path is None or (found is None and len(live.kept) == count):
            continue
        if found is None and len(live.kept) == count + 1:
            await _keep(node, partial(add_place, path, live.kept[-1]))
        else:
            await _keep(node, partial(begin_journal, path, *live.begun()))


async def _tell(node: Node, live: LiveRuns, found: RunRecord | Arrival) -> None:
    record = await node.in_thread(partial(live.record, found)) if isinstance(found, Arrival) else found
    node.health.count("cut" if record.running_time_s is None else "legs")
    await node.publish(RUN_RECORD, record)


def _journal_path(node: Node, config: Config) -> Path | None:
    """File of the leg under way; none in replays, which must not depend on what ran before."""
    if not config.state or not (config.state_folder or isinstance(node.clock, LiveClock)):
        return None
    return journal_file(state_dir(os.environ, config.state_folder or None), node.place.line, node.place.name)


def _resumed(node: Node, live: LiveRuns, path: Path) -> list[RunRecord | Arrival]:
    try:
        kept = read_journal(path)
    except (JournalError, OSError) as error:
        node.health.refuse(f"the leg kept cannot be used: {error}", node.clock.monotonic_s())
        return []
    return [] if kept is None else live.resume(*kept)


async def _keep(node: Node, write: Callable[[], None]) -> None:
    """A full disk does not stop the run history, but is told."""
    try:
        await node.in_thread(write)
    except OSError as error:
        node.health.set("state", f"cannot keep the leg under way: {error}")
    else:
        node.health.clear("state")


SERVICE = Service(
    "run_history",
    Config,
    reads=(TRAIN_POSITION,),
    writes=(RUN_RECORD,),
    run=run,
    about="running time and traction energy of every leg from station to station, from the train's positions",
)
