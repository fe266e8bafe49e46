"""Everything on the bus into a folder of recordings."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from schemas import topics
from schemas.topics import topic_of
from services.recorder.key_choice import fault_of
from services.recorder.mcap_file import Compression
from services.recorder.recording_store import RecordingStore, StoreSettings
from services.runtime.node import Node, Sample, Service
from services.runtime.state_dir import state_dir

MEGABYTE = 1_000_000
SAMPLE_OVERHEAD_BYTES = 300
"""What a sample takes in memory beside its payload, roughly."""
WRITE_EARLY_SHARE = 0.25
"""The writer is woken before the flush is due when the buffer is this full."""


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of a recorder."""

    key_expression: Annotated[str, Meta(min_length=1)] = topics.EVERYTHING
    """What is recorded."""
    folder: str | None = None
    """Where the recordings go; by default `recordings` in the host's state folder."""
    flush_s: Annotated[float, Meta(ge=0.05, le=60.0)] = 1.0
    """A crash costs at most what came within this time."""
    fsync: bool = True
    """Every flush waits until the disk has it, so that a power cut costs no more than a crash."""
    rotate_mb: Annotated[float, Meta(ge=1.0, le=1_000_000.0)] = 256.0
    """A new file begins when the file is this large."""
    rotate_s: Annotated[float, Meta(ge=1.0)] | None = 3600.0
    """Or when a message comes this long after the file's first."""
    keep_gb: Annotated[float, Meta(gt=0.0)] | None = None
    """The oldest own recordings are deleted to stay within this; nothing is deleted when left out."""
    resume_free_mb: Annotated[float, Meta(ge=0.0)] = 64.0
    """After a full disk recording goes on once this much is free."""
    buffer_mb: Annotated[float, Meta(ge=1.0, le=10_000.0)] = 64.0
    """Messages wait in memory for a slow disk up to this; further ones are dropped and counted."""
    compression: Compression = "zstd"
    """Of the files' chunks."""

    def __post_init__(self) -> None:
        """Refuse a key expression that is none, and a cap that cannot hold two files."""
        fault = fault_of(self.key_expression)
        if fault is not None:
            msg = f"key_expression {self.key_expression!r} {fault}"
            raise ValueError(msg)
        if self.keep_gb is not None and self.keep_gb * 1000.0 < 2.0 * self.rotate_mb:
            msg = f"keep_gb = {self.keep_gb:g} holds less than two files of rotate_mb = {self.rotate_mb:g}"
            raise ValueError(msg)

    def store_settings(self, default_folder: Path) -> StoreSettings:
        """Settings as the store takes them."""
        return StoreSettings(
            folder=Path(self.folder).expanduser() if self.folder else default_folder,
            rotate_bytes=round(self.rotate_mb * MEGABYTE),
            rotate_ns=None if self.rotate_s is None else round(self.rotate_s * 1e9),
            keep_bytes=None if self.keep_gb is None else round(self.keep_gb * 1000 * MEGABYTE),
            resume_free_bytes=round(self.resume_free_mb * MEGABYTE),
            compression=self.compression,
            fsync=self.fsync,
        )


@dataclass(slots=True)
class Buffer:
    """Samples on their way to the disk; bounded by what they take in memory."""

    limit_bytes: int
    dropped: int = 0
    ended: bool = False
    wake: asyncio.Event = field(default_factory=asyncio.Event)
    _samples: list[Sample] = field(default_factory=list)
    _bytes: int = 0

    def add(self, sample: Sample) -> None:
        """Take a sample; what comes while the buffer is full is counted and dropped."""
        size = len(sample.payload) + SAMPLE_OVERHEAD_BYTES
        if self._bytes + size > self.limit_bytes:
            self.dropped += 1
            return
        self._samples.append(sample)
        self._bytes += size
        if self._bytes > self.limit_bytes * WRITE_EARLY_SHARE:
            self.wake.set()

    def end(self) -> None:
        """Say that no more comes."""
        self.ended = True
        self.wake.set()

    def take(self) -> list[Sample]:
        """Everything that waits."""
        samples, self._samples, self._bytes = self._samples, [], 0
        if not self.ended:
            self.wake.clear()
        return samples


async def run(node: Node, config: Config) -> None:
    """Record until stopped. Raises FolderInUseError, and OSError when the folder cannot be made."""
    store = RecordingStore(config.store_settings(state_dir(os.environ) / "recordings"))
    leftovers = await node.in_thread(store.open)
    buffer = Buffer(round(config.buffer_mb * MEGABYTE))
    samples = node.samples(config.key_expression)
    node.ready()
    try:
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(_collect(node, samples, buffer), name="collect")
            repairs = tasks.create_task(_repair(node, store, leftovers), name="repair")
            await _write(node, buffer, store, config.flush_s)
            repairs.cancel()  # a repair under way does no harm and begins anew at the next start
    finally:
        await node.in_thread(store.close)
        _report(node, buffer, store)


async def _collect(node: Node, samples: AsyncIterator[Sample], buffer: Buffer) -> None:
    async for sample in samples:
        node.health.received += 1
        if topic_of(sample.key) is None:
            node.health.count("without_topic")
        buffer.add(sample)
    buffer.end()


async def _write(node: Node, buffer: Buffer, store: RecordingStore, flush_s: float) -> None:
    """Hand the buffer to the disk, and flush when that is due, until no more comes."""
    flush_at_s = node.clock.monotonic_s() + flush_s
    ended = False
    while not ended:
        with suppress(TimeoutError):
            async with asyncio.timeout(max(0.0, flush_at_s - node.clock.monotonic_s())):
                await buffer.wake.wait()
        ended = buffer.ended  # read before the last samples are taken, for more may come during a write
        due = node.clock.monotonic_s() >= flush_at_s
        if due:
            flush_at_s = node.clock.monotonic_s() + flush_s
        await node.in_thread(partial(_store, store, buffer.take(), flush=due))
        _report(node, buffer, store)


def _store(store: RecordingStore, batch: list[Sample], *, flush: bool) -> None:
    store.write(batch)
    if flush:
        store.flush()


async def _repair(node: Node, store: RecordingStore, leftovers: list[Path]) -> None:
    for path in leftovers:
        if node.stopping:
            return
        told = await node.in_thread(partial(store.repair_leftover, path))
        node.health.count("repaired")
        node.health.trouble(f"repair:{path.name}", told, node.clock.monotonic_s())


def _report(node: Node, buffer: Buffer, store: RecordingStore) -> None:
    """Counts into health; a fault makes the level `failed`, of which the runtime makes an event."""
    board = node.health
    new_drops = buffer.dropped - board.counts.get("dropped_at_buffer", 0)
    if new_drops:
        now_s = node.clock.monotonic_s()
        board.trouble("buffer", f"the disk is too slow: {new_drops} messages dropped", now_s)
    board.counts |= {
        "recorded": store.recorded,
        "lost": store.lost,
        "unrecordable": store.unrecordable,
        "files": store.files,
        "deleted_files": store.deleted,
        "dropped_at_buffer": buffer.dropped,
    }
    for note in store.take_notes():
        board.trouble("note", note, node.clock.monotonic_s())
    if store.fault is None:
        board.clear("disk")
    else:
        board.set("disk", f"not recording, {store.lost} messages lost so far: {store.fault}", "failed")


SERVICE = Service(
    "recorder",
    Config,
    reads=topics.ALL,
    writes=(),
    run=run,
    about="keeps everything on the bus in MCAP files that survive crashes, full disks and power cuts",
)
