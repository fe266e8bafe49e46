"""`kirotei record`: the bus into one file until Ctrl-C."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NoReturn

from schemas.topic import Place
from services.recorder.bus_session_command import BusSession
from services.recorder.contents_words import megabytes
from services.recorder.mcap_file import RecordingWriter, UnrecordableError
from services.recorder.part_file import PartFile
from services.recorder.progress_command import ProgressLine
from services.runtime.node import Node, Sample
from services.runtime.zenoh_node import ZenohNode

FLUSH_S = 1.0
MAX_WAITING_BYTES = 256_000_000
"""More than this is not kept in memory for a slow disk."""
SAMPLE_OVERHEAD_BYTES = 300


@dataclass(slots=True)
class _File:
    """One recording in the making, and the samples on their way into it."""

    part: PartFile
    writer: RecordingWriter
    waiting: list[Sample] = field(default_factory=list)
    waiting_bytes: int = 0
    dropped: int = 0
    unrecordable: int = 0

    @classmethod
    def create(cls, out: Path) -> _File:
        part = PartFile(out)
        return cls(part, RecordingWriter(part))

    def add(self, sample: Sample) -> None:
        size = len(sample.payload) + SAMPLE_OVERHEAD_BYTES
        if self.waiting_bytes + size > MAX_WAITING_BYTES:
            self.dropped += 1
            return
        self.waiting.append(sample)
        self.waiting_bytes += size

    def take(self) -> list[Sample]:
        batch, self.waiting, self.waiting_bytes = self.waiting, [], 0
        return batch

    def write(self, batch: list[Sample]) -> None:
        for sample in batch:
            try:
                self.writer.write(sample)
            except UnrecordableError:
                self.unrecordable += 1
        self.writer.flush()
        self.part.commit()

    def complete(self, batch: list[Sample]) -> None:
        self.write(batch)
        self.writer.finish()
        self.part.complete()


def run_record(out: Path, key_expression: str, endpoint: str, duration_s: float | None, *, as_json: bool) -> NoReturn:
    """Record until Ctrl-C, or for `duration_s`; ends the process."""

    async def work(node: ZenohNode) -> int:
        if duration_s is not None:
            asyncio.get_running_loop().call_later(duration_s, node.stop)
        return await record(node, out, key_expression, as_json=as_json)

    BusSession("record", Place("any", "cloud", "recorders"), endpoint, work).run()


async def record(node: Node, out: Path, key_expression: str, *, as_json: bool) -> int:
    """Record until the node is stopped; exit code. The file stands under `.part` until it is complete."""
    samples = node.samples(key_expression)
    file = _File.create(out)
    started_s = node.clock.monotonic_s()
    reason = None
    try:
        async with asyncio.TaskGroup() as tasks:
            collecting = tasks.create_task(_collect(samples, file))
            await _keep_writing(node, file, started_s)
            await collecting
        await node.in_thread(partial(file.complete, file.take()))
    except* OSError as group:
        first = group.exceptions[0]
        reason = (first.strerror if isinstance(first, OSError) else None) or str(first)
    if reason is not None:
        file.part.leave()
        part = file.part.part
        kept = f"what was written before is in it: `kirotei recording repair {part}` completes it"
        sys.stderr.write(f"kirotei record: {part}: {reason}; {kept}\n")
        return 1
    _tell_result(file, node.health.dropped, node.clock.monotonic_s() - started_s, as_json=as_json)
    return 0


async def _collect(samples: AsyncIterator[Sample], file: _File) -> None:
    async for sample in samples:
        file.add(sample)


async def _keep_writing(node: Node, file: _File, started_s: float) -> None:
    line = ProgressLine(node.clock.monotonic_s)
    while await node.sleep(FLUSH_S):
        batch = file.take()
        await node.in_thread(partial(file.write, batch))
        elapsed_s = node.clock.monotonic_s() - started_s
        line.update(partial(_progress, file, len(batch), elapsed_s))
    line.done()


def _progress(file: _File, newest: int, elapsed_s: float) -> str:
    dropped = f", {file.dropped} dropped" if file.dropped else ""
    rate_hz = newest / FLUSH_S
    return (
        f"{elapsed_s:.0f} s: {file.writer.messages} messages, {rate_hz:.0f}/s, {megabytes(file.part.tell())}{dropped}"
    )


def _tell_result(file: _File, pushed_out: int, elapsed_s: float, *, as_json: bool) -> None:
    dropped = file.dropped + pushed_out
    if as_json:
        result = {
            "file": str(file.part.final),
            "messages": file.writer.messages,
            "bytes": file.part.tell(),
            "dropped": dropped,
            "unrecordable": file.unrecordable,
            "duration_s": round(elapsed_s, 3),
        }
        sys.stdout.write(json.dumps(result, indent=2) + "\n")
        return
    lost = f"; {dropped} dropped, the disk or this machine was too slow" if dropped else ""
    size = megabytes(file.part.tell())
    sys.stdout.write(f"{file.part.final}: {file.writer.messages} messages in {elapsed_s:.0f} s, {size}{lost}\n")
