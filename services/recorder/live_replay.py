"""A recording onto the bus again: the original keys and bytes, at their pace or faster.

The sender's mark is the replay's own, so that nobody takes it for the train. Measurement times
inside the messages stay those of the recording.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Protocol

import msgspec

from schemas.topic import ROOT, Address, TopicError
from schemas.topics import topic_of
from services.recorder.mcap_file import Lane
from services.runtime.alive import AliveChange
from services.runtime.node import Node, Sample

LONGEST_WAIT_S = 60.0
"""A longer silence in the recording is passed over in this time."""
BATCH = 256
"""Samples read at a time, off the loop."""
TURN = 32
"""Publications after which other tasks get their turn when nothing is waited for."""


class OriginalAliveError(RuntimeError):
    """A sender of the recording lives on this bus: two trains would be mixed into one."""


class ReplayConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of a live replay."""

    speed: float = 1.0
    """Recorded seconds per second; 0 for as fast as it goes."""
    line: str | None = None
    """Railway line onto whose keys the recording is put, instead of its own."""


class EncodedNode(Node, Protocol):
    """A node that can speak on any key."""

    async def publish_encoded(self, key: str, payload: bytes) -> None:
        """Put an encoded message on a concrete key."""


class AliveNode(Protocol):
    """A node that knows who lives on the bus."""

    async def services_alive(self, line: str = "*") -> set[str]:
        """Services that live now, by place and instance."""

    def watch_alive(self, line: str = "*") -> AsyncIterator[AliveChange]:
        """Services as they appear and are lost."""


class ReplayNode(EncodedNode, AliveNode, Protocol):
    """What a live replay needs."""


@dataclass(slots=True)
class Played:
    """How far a replay has come."""

    published: int = 0
    without_topic: int = 0
    """Left out: no topic has their key."""
    time_ns: int = 0
    """Recorded time of the newest."""
    behind_s: float = 0.0
    """How late the newest was published."""


def on_line(key: str, line: str | None) -> str:
    """Key (or source) on another line.

    >>> on_line("kirotei/v1/demo/train/T1/gnss/front/fix", "rehearsal")
    'kirotei/v1/rehearsal/train/T1/gnss/front/fix'
    """
    if line is None:
        return key
    root, _, rest = key.partition(f"{ROOT}/")
    return key if root or not rest else f"{ROOT}/{line}/{rest.partition('/')[2]}"


def senders(lanes: Iterable[Lane], line: str | None) -> set[str]:
    """Services whose messages the lanes hold, as they would be called on `line`."""
    sources = {lane.source for lane in lanes if lane.source}
    return sources if line is None else {f"{line}/{source.partition('/')[2]}" for source in sources}


async def require_absent(node: AliveNode, original: set[str]) -> None:
    """Raise OriginalAliveError when one of the services lives on the bus."""
    alive = sorted(original & await node.services_alive())
    if alive:
        raise _refusal(alive)


def _refusal(alive: list[str]) -> OriginalAliveError:
    shown = ", ".join(alive[:5]) + (f" and {len(alive) - 5} more" if len(alive) > 5 else "")  # noqa: PLR2004 - as many as shown
    return OriginalAliveError(
        f"{shown} live on this bus and would be mixed with the recording: stop them, choose other keys with --key, "
        "or put the recording onto another line with --line NAME"
    )


async def watch_absent(node: AliveNode, original: set[str]) -> None:
    """Raise OriginalAliveError as soon as one of the services appears on the bus."""
    async for change in node.watch_alive():
        if change.alive and change.token.service in original:
            raise _refusal([change.token.service])


async def play(
    node: EncodedNode, samples: Iterator[Sample], config: ReplayConfig, progress: Callable[[Played], None]
) -> Played:
    """Publish samples until they end or the node is stopped; `progress` is called after each batch.

    Times that step back in the recording cost no waiting. Raises RecordingError for a file
    that turns out to be damaged.
    """
    played = Played()
    pace = _Pace(node, config.speed)
    while batch := await node.in_thread(lambda: list(islice(samples, BATCH))):
        for sample in batch:
            if not await pace.wait(sample.received_ns):
                return played
            await _publish(node, sample, config.line, played)
            played.behind_s = pace.behind_s()
        progress(played)
    return played


async def _publish(node: EncodedNode, sample: Sample, line: str | None, played: Played) -> None:
    key = on_line(sample.key, line)
    played.time_ns = sample.received_ns
    if topic_of(key) is None:
        played.without_topic += 1
        return
    await node.publish_encoded(key, sample.payload)
    played.published += 1


class _Pace:
    """When the next sample is due."""

    def __init__(self, node: Node, speed: float) -> None:
        self._node = node
        self._speed = speed
        self._due_s = node.clock.monotonic_s()
        self._newest_ns: int | None = None
        self._unwaited = 0

    async def wait(self, received_ns: int) -> bool:
        """Wait until a sample is due; False when the node is stopping."""
        if self._newest_ns is None:
            self._newest_ns = received_ns
        ahead_ns = received_ns - self._newest_ns
        if ahead_ns > 0 and self._speed > 0.0:
            self._due_s += min(ahead_ns / 1e9 / self._speed, LONGEST_WAIT_S)
        self._newest_ns = max(self._newest_ns, received_ns)
        left_s = self._due_s - self._node.clock.monotonic_s()
        self._unwaited += 1
        if left_s <= 0.0 and self._unwaited < TURN:
            return not self._node.stopping
        self._unwaited = 0
        return await self._node.sleep(max(left_s, 0.0))

    def behind_s(self) -> float:
        """How much later than due it is; 0 when no pace is kept."""
        return max(0.0, self._node.clock.monotonic_s() - self._due_s) if self._speed > 0.0 else 0.0


def first_address(lanes: Iterable[Lane], line: str | None) -> Address:
    """Address of the first lane that has a topic, on `line`. Raises TopicError when none has."""
    for lane in lanes:
        address = topic_of(on_line(lane.key, line))
        if address is not None:
            return address
    msg = "the recording holds no message of a known topic" + (f" for line {line!r}" if line else "")
    raise TopicError(msg)


async def play_apart(
    node: ReplayNode,
    samples: Iterator[Sample],
    original: set[str],
    config: ReplayConfig,
    progress: Callable[[Played], None],
) -> Played:
    """Play while none of the original senders lives on the bus.

    Raises OriginalAliveError before the first publication, or when one appears later.
    """
    await require_absent(node, original)
    playing = asyncio.ensure_future(play(node, samples, config, progress))
    watching = asyncio.ensure_future(watch_absent(node, original))
    try:
        done, _ = await asyncio.wait({playing, watching}, return_when=asyncio.FIRST_COMPLETED)
        if watching in done:
            watching.result()
        return await playing
    finally:
        playing.cancel()
        watching.cancel()
        await asyncio.wait({playing, watching})
