"""A recording through services again, at full speed, in virtual time.

Every message that the chosen services read is put on a bus in memory at its recorded time and
with its recorded attachment; between two messages the services run until nothing is left to
do. The same recording gives the same publications, byte for byte.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import msgspec

from schemas.message import Message
from schemas.topic import Address, Place, Topic
from schemas.topics import topic_of
from services.runtime.attachment import decode_attachment
from services.runtime.clock import ManualClock
from services.runtime.manual_loop import ManualLoop, manual_loop
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Sample, Service

LONGEST_GAP_S = 3600.0
"""Where a recording is silent for longer, that much time passes and the calendar is set forward by the rest."""
STEP_BACK_NS = 1_000_000_000
"""A recorded time further back than this means that the recorder's calendar was set back."""
STOP_WITHIN_S = 60.0
"""Virtual time that a service may take to finish."""
REPLAY_INSTANCE = "replay"
"""Instance under which a live replay speaks."""


class ReplayError(RuntimeError):
    """A service failed during a replay, or cannot be replayed into."""


@dataclass(frozen=True, slots=True)
class Part:
    """A service that takes part in a replay."""

    service: Service[Any]
    config: msgspec.Struct
    instance: str


@dataclass(slots=True)
class _Run:
    part: Part
    node: MemoryNode
    task: asyncio.Task[None]


@dataclass(slots=True)
class OfflineReplay:
    """Feeds recorded samples to services on a manual loop; `published` hears everything they say.

    A service starts at every place of which it reads something, or at `place` alone.
    """

    loop: ManualLoop
    parts: Sequence[Part]
    published: Callable[[Sample], None]
    place: Place | None = None
    started: Callable[[], None] | None = None
    """Called when a service has started at a place."""
    fed: int = 0
    left_out: int = 0
    """Outputs that the services had published when it was recorded, and what none of them reads."""
    _bus: MemoryBus = field(init=False)
    _clock: ManualClock | None = None
    _runs: dict[tuple[str, Place], _Run] = field(default_factory=dict)
    _ended: list[asyncio.Task[None]] = field(default_factory=list)
    _wanted: dict[str, Address | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Make the bus. Raises ReplayError for a service that reads nothing."""
        for part in self.parts:
            if not part.service.reads:
                msg = f"{part.instance} reads no topic: nothing can be replayed into it"
                raise ReplayError(msg)
        self._bus = MemoryBus(on_publish=self.published)

    @property
    def elapsed_s(self) -> float:
        """Virtual time since the first sample that was fed."""
        return 0.0 if self._clock is None else self._clock.monotonic_s()

    def feed(self, sample: Sample) -> None:
        """Move time to the sample's, let the services do what is due, and hand the sample over.

        Raises ReplayError when a service has failed.
        """
        address = self._address(sample)
        if address is None:
            self.left_out += 1
            return
        clock = self._clock_at(sample.received_ns)
        for part in self.parts:
            if address.topic in part.service.reads:
                self._start(part, self.place or address.place, clock)
        self._bus.put(sample, address.topic.delivery)
        self.fed += 1

    def finish(self) -> None:
        """Let the services finish. Raises ReplayError when one fails, or does not end."""
        self.loop.settle()
        self._look()
        for run in self._runs.values():
            run.node.stop()
        self.loop.settle()
        if any(not run.task.done() for run in self._runs.values()):
            self.loop.advance(STOP_WITHIN_S)
        self._look()
        for run in self._runs.values():
            if not run.task.done():
                msg = f"{run.part.instance} at {run.node.place} does not end {STOP_WITHIN_S:g} s after it was asked to"
                raise ReplayError(msg)

    def _address(self, sample: Sample) -> Address | None:
        """Address of a sample that is to be fed; None for one that is to be left out."""
        if sample.key in self._wanted:
            address = self._wanted[sample.key]
        else:
            found = topic_of(sample.key)
            read = found is not None and any(found.topic in part.service.reads for part in self.parts)
            address = self._wanted[sample.key] = found if read else None
        if address is None or not self._is_output(address.topic, sample):
            return address
        return None

    def _is_output(self, topic: Topic[Message], sample: Sample) -> bool:
        """True for what one of the services published at the time (or may have: its sender is unknown)."""
        writers = {part.service.name for part in self.parts if topic in part.service.writes}
        if not writers:
            return False
        mark = decode_attachment(sample.attachment) if sample.attachment else None
        if mark is None:
            return True
        sender = mark.source.rpartition("/")[2].partition("@")[0]
        return sender in writers or sender == REPLAY_INSTANCE

    def _clock_at(self, received_ns: int) -> ManualClock:
        """Clock, once the services have done all that is due until then."""
        clock = self._clock
        if clock is None:
            clock = self._clock = ManualClock(self.loop, received_ns)
            return clock
        ahead_ns = received_ns - clock.now_ns()
        self.loop.advance(min(max(ahead_ns, 0) / 1e9, LONGEST_GAP_S))
        if ahead_ns < -STEP_BACK_NS or ahead_ns > LONGEST_GAP_S * 1e9:
            clock.step(received_ns - clock.now_ns())
        self._look()
        return clock

    def _start(self, part: Part, place: Place, clock: ManualClock) -> None:
        """Start a service at a place unless it was started there before."""
        if (part.instance, place) in self._runs:
            return
        kinds = {topic.template.partition("/")[0] for topic in part.service.writes} - {"{kind}"}
        if kinds - {place.kind}:
            msg = f"{part.instance} works at a {' or '.join(sorted(kinds))}, not at {place}: say where with --place"
            raise ReplayError(msg)
        node = MemoryNode(self._bus, part.service, place, clock, part.instance)
        task = self.loop.create_task(node.run(part.config), name=f"{place}/{part.instance}")
        task.add_done_callback(self._ended.append)
        self._runs[part.instance, place] = _Run(part, node, task)
        self.loop.settle()
        self._look()
        if self.started is not None:
            self.started()

    def _look(self) -> None:
        """Raise ReplayError when a service has failed."""
        for task in self._ended:
            error = None if task.cancelled() else task.exception()
            if error is not None and self._clock is not None:
                when = datetime.fromtimestamp(self._clock.now_ns() // 1_000_000_000, UTC)
                first = _first(error)
                what = f"{type(first).__name__}: {first}"
                msg = f"{task.get_name()} failed at {when:%Y-%m-%d %H:%M:%S} UTC, after {self.fed} messages: {what}"
                raise ReplayError(msg) from error
        self._ended.clear()


def _first(error: BaseException) -> BaseException:
    """What went wrong first, out of the groups that tasks wrap it in."""
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error


def replay(
    samples: Iterable[Sample],
    parts: Sequence[Part],
    published: Callable[[Sample], None],
    place: Place | None = None,
    started: Callable[[], None] | None = None,
) -> OfflineReplay:
    """Run recorded samples through services; returns the counts. Raises ReplayError."""
    with manual_loop() as loop:
        run = OfflineReplay(loop, parts, published, place, started)
        for sample in samples:
            run.feed(sample)
        run.finish()
        return run


def replay_through(
    samples: Iterable[Sample],
    services: Sequence[Service[Any]],
    configs: Mapping[str, msgspec.Struct] | None = None,
    place: Place | None = None,
) -> list[Sample]:
    """Everything that services publish when they hear recorded samples.

    `configs` gives a service's configuration by its name; the others run on their defaults.
    Raises ReplayError.
    """
    given = configs or {}
    parts = [Part(service, given.get(service.name) or service.config(), service.name) for service in services]
    heard: list[Sample] = []
    replay(samples, parts, heard.append, place)
    return heard
