"""The train's position on the bus: sources in, one position out, ten times a second."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, Final

from schemas.message import Message
from schemas.motion import Odometry, WheelScale
from schemas.position import PositionEvent, ReferencePass, TrainPosition
from schemas.topics import (
    BALISE,
    BRANCH_EVIDENCE,
    GNSS_FIX,
    GNSS_FRONT_END,
    LANDMARK_MATCH,
    ODOMETRY,
    POSITION_EVENT,
    REFERENCE_PASS,
    SLIP_EPISODE,
    TRAIN_CHANGE,
    TRAIN_POSITION,
    WHEEL_SCALE,
)
from services.line.line_file import load_line
from services.runtime.clock import LiveClock
from services.runtime.node import Arrival, Node, Service
from services.runtime.state_dir import state_dir
from services.train_position.keeper import PositionKeeper
from services.train_position.line_places import LinePlaces
from services.train_position.position_store import StoreError, read_snapshot, state_file, write_snapshot
from services.train_position.settings import Config
from services.train_position.snapshot import Snapshot

TICK_S: Final = 0.1
SAVE_S: Final = 1.0
"""A crash costs no more than this of the state; the odometry's way bridges it."""


class _Speaker:
    """Publishes what the keeper says, and tells health of it."""

    def __init__(self, node: Node, keeper: PositionKeeper) -> None:
        self._node, self._keeper = node, keeper
        self.odometry_ns: int | None = None
        """Time of the newest message of the odometry,"""
        self.heard_s = node.clock.monotonic_s()
        """and when it came."""

    async def say(self, told: list[Message]) -> None:
        """Publish in order."""
        node = self._node
        for message in told:
            match message:
                case TrainPosition():
                    self._look(message)
                    await node.publish(TRAIN_POSITION, message)
                case ReferencePass():
                    node.health.count("references")
                    node.health.count("references_within_bound", int(message.within))
                    await node.publish(REFERENCE_PASS, message)
                case PositionEvent():
                    node.health.count(f"events_{message.kind}")
                    await node.publish(POSITION_EVENT, message)
                case WheelScale():
                    await node.publish(WHEEL_SCALE, message)
                case _:
                    pass
        for reason in self._keeper.take_refusals():
            node.health.refuse(reason, node.clock.monotonic_s())

    def _look(self, position: TrainPosition) -> None:
        self._node.health.count("positions")
        if position.status == "valid":
            self._node.health.clear("position")
        else:
            self._node.health.set("position", f"position {position.status}: {position.reason}")


async def run(node: Node, config: Config) -> None:
    """Answer every message of the odometry with a position; go on without it once it is silent."""
    # Subscribed before anything is loaded: nothing said meanwhile is lost.
    moving = node.arrivals(ODOMETRY, LANDMARK_MATCH, BRANCH_EVIDENCE, SLIP_EPISODE)
    fixing = node.arrivals(GNSS_FRONT_END, GNSS_FIX, BALISE, TRAIN_CHANGE)
    line: LinePlaces | None = None
    if config.line_file:
        line = await node.in_thread(lambda: _load(Path(config.line_file)))
    path = _state_path(node, config)
    kept = None if path is None else await node.in_thread(lambda: _read(node, path))
    keeper = PositionKeeper(config, line, kept)
    speaker = _Speaker(node, keeper)
    node.ready()
    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(_hear(fixing, keeper, speaker), name="places")
        ticking = [tasks.create_task(_tick(node, config, keeper, speaker), name="silence")]
        if path is not None:
            ticking.append(tasks.create_task(_save(node, keeper, path), name="state"))
        await _hear_motion(node, moving, keeper, speaker)
        for task in ticking:
            task.cancel()
    if path is not None:
        await _write(node, keeper, path)


def _load(path: Path) -> LinePlaces:
    line = LinePlaces(load_line(path).line)
    line.warm_up()
    return line


async def _hear(arrivals: AsyncIterator[Arrival[Any]], keeper: PositionKeeper, speaker: _Speaker) -> None:
    async for arrival in arrivals:
        await speaker.say(keeper.on_message(arrival.message, arrival.fields.get("device", "")))


async def _hear_motion(
    node: Node, arrivals: AsyncIterator[Arrival[Any]], keeper: PositionKeeper, speaker: _Speaker
) -> None:
    async for arrival in arrivals:
        heard_s = node.clock.monotonic_s()
        if isinstance(arrival.message, Odometry):
            speaker.odometry_ns, speaker.heard_s = arrival.message.t_ns, heard_s
        await speaker.say(keeper.on_message(arrival.message, heard_s=heard_s))


async def _tick(node: Node, config: Config, keeper: PositionKeeper, speaker: _Speaker) -> None:
    """Positions while the odometry is silent, on its own scale of time: it always lags by the same delay."""
    while await node.sleep(TICK_S):
        silent_s = node.clock.monotonic_s() - speaker.heard_s
        if silent_s < config.silent_s:
            continue
        begun_ns = speaker.odometry_ns
        now_ns = node.clock.now_ns() if begun_ns is None else begun_ns + round(silent_s * 1e9)
        await speaker.say(keeper.on_time(now_ns))


async def _save(node: Node, keeper: PositionKeeper, path: Path) -> None:
    while await node.sleep(SAVE_S):
        await _write(node, keeper, path)


async def _write(node: Node, keeper: PositionKeeper, path: Path) -> None:
    """Keep the state; a full disk does not stop the position, but is told."""
    snapshot = keeper.snapshot()
    if snapshot is None:
        return
    try:
        await node.in_thread(lambda: write_snapshot(path, snapshot))
    except OSError as error:
        node.health.set("state", f"cannot keep the position: {error}")
    else:
        node.health.clear("state")


def _state_path(node: Node, config: Config) -> Path | None:
    if not config.state or not (config.state_folder or isinstance(node.clock, LiveClock)):
        return None
    return state_file(state_dir(os.environ, config.state_folder or None), node.place.line, node.place.name)


def _read(node: Node, path: Path) -> Snapshot | None:
    """State kept before; without it the position begins anew."""
    try:
        return read_snapshot(path)
    except (StoreError, OSError) as error:
        node.health.refuse(f"the position kept cannot be used: {error}", node.clock.monotonic_s())
        return None


SERVICE = Service(
    "train_position",
    Config,
    reads=(
        ODOMETRY,
        LANDMARK_MATCH,
        BRANCH_EVIDENCE,
        SLIP_EPISODE,
        GNSS_FRONT_END,
        GNSS_FIX,
        BALISE,
        TRAIN_CHANGE,
    ),
    writes=(TRAIN_POSITION, REFERENCE_PASS, POSITION_EVENT, WHEEL_SCALE),
    run=run,
    about="one position of the train on its line, with its bounds, from odometry, landmarks, satellites and balises",
)
