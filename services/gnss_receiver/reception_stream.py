"""What a receiver says, live or from a recording, as one stream for whichever service wants it."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Final

from schemas.gnss import Epoch, OwnPosition
from services.byte_source.source import ByteSource
from services.gnss_receiver.heard import Heard
from services.gnss_receiver.live_stream import connection, follow
from services.gnss_receiver.observations import Navigation
from services.gnss_receiver.reception import FileSource, Reception, recorded_ns
from services.gnss_receiver.recorded_playback import BroadcastBeside, epochs_of, with_broadcast
from services.gnss_receiver.recording_file import heard_in, open_recording
from services.gnss_receiver.rinex_navigation_file import read_navigation
from services.gnss_receiver.rinex_observation_file import read_observations
from services.runtime.node import Node

LONGEST_WAIT_S: Final = 60.0
"""A longer gap in a recording is passed over in this time, as far as waiting goes."""
PAUSE_S: Final = 1.0
"""Between the end of a recording and its beginning."""
LATEST_S: Final = 1.0
"""After an epoch later than this (the host slept) the pace starts anew, instead of catching up in a burst."""


async def receive(node: Node, config: Reception) -> AsyncIterator[Heard]:
    """Everything that the configured receiver says, until its recording ends or the service is to stop.

    Says `node.ready()` when a recording has been read, or when a live source is about to be opened.
    A live source that fails is opened again, and health says why. A recording that cannot be read
    raises RinexError, OSError or ValueError.
    """
    if config.source is None:
        reading = _observed(node, config)
    elif isinstance(config.source, FileSource):
        reading = _replayed(node, config, config.source)
    else:
        reading = _live(node, config, connection(config.source, node.clock))
    async for heard in reading:
        yield heard


async def _observed(node: Node, config: Reception) -> AsyncIterator[Heard]:
    """A recording of observations, read whole."""
    path = config.observations or ""
    observations = await node.in_thread(lambda: read_observations(Path(path)))
    navigation = await _navigation(node, config)
    issues = (*observations.issues, *navigation.issues)
    node.health.count("epochs_read", len(observations))
    node.health.count("ephemerides_read", len(navigation.ephemerides))
    node.health.count("issues", len(issues))
    if issues:
        node.health.set("issues", f"{len(issues)} things in the files were refused, the first: {issues[0]}")
    if not len(observations):
        msg = f"{path} holds no epoch that can be read"
        raise ValueError(msg)
    node.ready()
    going_on = True
    while going_on:
        async for heard in _paced(node, with_broadcast(epochs_of(observations), navigation), config.speed):
            yield heard
        going_on = await _again(node, config)


async def _replayed(node: Node, config: Reception, source: FileSource) -> AsyncIterator[Heard]:
    """A recording of a receiver's bytes, read as they would come."""
    navigation = await _navigation(node, config)
    going_on, is_ready = True, False
    while going_on:
        content, stream = await node.in_thread(lambda: open_recording(Path(source.path), recorded_ns(source)))
        if not is_ready:
            node.ready()
            is_ready = True
        async for heard in _paced(node, with_broadcast(heard_in(content, stream), navigation), config.speed):
            node.health.counts.update(stream.counts)
            yield heard
        node.health.counts.update(stream.counts)
        going_on = await _again(node, config)


async def _live(node: Node, config: Reception, source: ByteSource) -> AsyncIterator[Heard]:
    beside = BroadcastBeside(await _navigation(node, config))
    node.ready()
    async for heard in follow(node, config, source):
        for one in beside.before(heard):
            yield one
        yield heard


async def _navigation(node: Node, config: Reception) -> Navigation:
    return await node.in_thread(lambda: read_navigation([Path(path) for path in config.navigation]))


async def _again(node: Node, config: Reception) -> bool:
    """Whether a recording that has ended begins again."""
    if node.stopping or not config.repeat:
        return False
    node.health.count("repetitions")
    return await node.sleep(PAUSE_S / config.speed if config.speed else 0.0)


async def _paced(node: Node, recorded: Iterator[Heard], speed: float) -> AsyncIterator[Heard]:
    """What a recording says, each epoch at its own time; what comes before an epoch waits for it."""
    due_s = node.clock.monotonic_s()
    previous_ns: int | None = None
    waiting: list[Heard] = []
    for heard in recorded:
        waiting.append(heard)
        if not isinstance(heard, Epoch | OwnPosition):
            continue
        # Repeated and out-of-order epochs follow at once: a receiver gave them so.
        passed_s = 0.0 if previous_ns is None else (heard.t_ns - previous_ns) / 1e9
        previous_ns = heard.t_ns
        due_s += min(max(passed_s, 0.0), LONGEST_WAIT_S) / speed if speed else 0.0
        if not await node.sleep(max(due_s - node.clock.monotonic_s(), 0.0)):
            return
        late_s = node.clock.monotonic_s() - due_s
        due_s += late_s if late_s > LATEST_S else 0.0
        for one in waiting:
            yield one
        waiting.clear()
    for one in waiting:
        yield one
