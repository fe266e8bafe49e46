"""Odometry on the bus: samples of an inertial sensor and of axles in, way, speed, slips and their bound out."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path
from typing import Final

import numpy as np

from schemas.motion import ImuBlock, Odometry, SlipEpisode, TachoBlock, WheelScale
from schemas.topics import IMU, ODOMETRY, SLIP_EPISODE, TACHO, WHEEL_SCALE
from services.odometry_fusion.live_odometry import LiveOdometry
from services.odometry_fusion.methods import run_log
from services.odometry_fusion.motion_log import MotionLog, Remembered
from services.odometry_fusion.odometry_store import StoreError, read_state, state_file, write_state
from services.odometry_fusion.settings import Config
from services.runtime.clock import LiveClock
from services.runtime.node import Node, Service
from services.runtime.state_dir import state_dir

TICK_S: Final = 0.1
SAVE_S: Final = 60.0
"""Biases drift more slowly than this."""


async def run(node: Node, config: Config) -> None:
    """Give odometry until asked to stop; on without samples once they stay away."""
    # Subscribed before the kernels are ready: nothing said meanwhile is lost.
    arrivals = node.arrivals(IMU, TACHO, WHEEL_SCALE)
    path = _state_path(node, config)
    starts, known = (0, None) if path is None else await node.in_thread(lambda: _read(node, path))
    await node.in_thread(lambda: _warm_up(config))
    live = _Live(node, LiveOdometry(config, node.place.name, starts + 1, known))
    if path is not None:
        await _write(node, path, starts + 1, known)
    node.ready()
    async with asyncio.TaskGroup() as tasks:
        ticking = [tasks.create_task(live.tick(), name="silence")]
        if path is not None:
            ticking.append(tasks.create_task(_save(node, live.odometry, path, starts + 1), name="state"))
        async for arrival in arrivals:
            if isinstance(arrival.message, WheelScale):
                live.odometry.take_scale(arrival.message)
            else:
                await live.take(arrival.message, arrival.fields["device"])
        for task in ticking:
            task.cancel()
    if path is not None:
        await _write(node, path, starts + 1, live.odometry.remembered())


class _Live:
    """Odometry, and what is said of it."""

    def __init__(self, node: Node, odometry: LiveOdometry) -> None:
        self.odometry = odometry
        self._node = node
        self._heard_s = node.clock.monotonic_s()

    async def take(self, block: ImuBlock | TachoBlock, device: str) -> None:
        """One block in, and what it makes due out."""
        self._heard_s = self._node.clock.monotonic_s()
        await self._say(self.odometry.take(block, device))

    async def tick(self) -> None:
        """Rows while everything is silent."""
        while await self._node.sleep(TICK_S):
            await self._say(self.odometry.silent(self._node.clock.monotonic_s() - self._heard_s))

    async def _say(self, found: list[Odometry | SlipEpisode]) -> None:
        health = self._node.health
        for message in found:
            match message:
                case Odometry():
                    health.count("rows")
                    await self._node.publish(ODOMETRY, message)
                case SlipEpisode():
                    health.count(f"slips_{message.phase}")
                    await self._node.publish(SLIP_EPISODE, message)
        rows = [message for message in found if isinstance(message, Odometry)]
        if not rows:
            return
        health.counts.update(self.odometry.counts)
        if rows[-1].status == "valid":
            health.clear("odometry")
        else:
            health.set("odometry", f"{rows[-1].status}: {rows[-1].reason}")


def _warm_up(config: Config) -> None:
    """Compile the kernels, or load them from their cache, before the first sample waits for them."""
    t_s = np.arange(0.0, 5.0, 0.1)
    still = np.tile([0.0, 0.0, 9.8, 0.0, 0.0, 0.0], (len(t_s), 1))
    run_log(MotionLog(t_s, still, t_s, np.zeros(len(t_s), np.int64), 90.0, 0.816, 0.3, 35.0), config)


def _state_path(node: Node, config: Config) -> Path | None:
    """File for the state; none in replays, which must not depend on what ran before."""
    if not config.state or not (config.state_folder or isinstance(node.clock, LiveClock)):
        return None
    return state_file(state_dir(os.environ, config.state_folder or None), node.place.line, node.place.name)


def _read(node: Node, path: Path) -> tuple[int, Remembered | None]:
    """State kept before; without it everything is learned anew, under a name that no earlier origin had."""
    try:
        return read_state(path)
    except (StoreError, OSError) as error:
        node.health.refuse(f"the state kept cannot be used: {error}", node.clock.monotonic_s())
        return node.clock.now_ns() // 1_000_000_000, None


async def _save(node: Node, odometry: LiveOdometry, path: Path, starts: int) -> None:
    while await node.sleep(SAVE_S):
        await _write(node, path, starts, odometry.remembered())


async def _write(node: Node, path: Path, starts: int, known: Remembered | None) -> None:
    """Keep the state; a full disk does not stop odometry, but is told."""
    try:
        await node.in_thread(lambda: write_state(path, starts, known))
    except OSError as error:
        node.health.set("state", f"cannot keep the state: {error}")
    else:
        node.health.clear("state")


SERVICE = Service(
    "odometry_fusion",
    Config,
    reads=(IMU, TACHO, WHEEL_SCALE),
    writes=(ODOMETRY, SLIP_EPISODE),
    run=run,
    about="way gone and speed by wheel and inertial sensor, slips corrected, with the error that is vouched for",
)
