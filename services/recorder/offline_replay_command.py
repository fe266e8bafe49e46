"""`kirotei replay --through`: a recording through services, into another recording."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from schemas.topic import PLACE_KINDS, Place, TopicError
from services.recorder.mcap_file import RecordingWriter
from services.recorder.offline_replay import OfflineReplay, Part, ReplayError, replay
from services.recorder.part_file import PartFile
from services.recorder.progress_command import ProgressLine
from services.recorder.recording_file import message_count, read_recording
from services.runtime.catalogue import load_service, service_name
from services.runtime.config import load_host
from services.runtime.node import Sample
from services.runtime.state_dir import prepare, state_dir

COMMIT_BYTES = 8 * 1024 * 1024
TOLD_EVERY = 256
"""Messages between two looks at the clock."""


@dataclass(frozen=True, slots=True)
class Replayed:
    """What came of a replay."""

    fed: int
    left_out: int
    published: int
    recorded_s: float
    """Time between the first and the last message fed."""
    start_s: float
    """Until the first service had started: kernels loaded or compiled."""
    took_s: float
    """From then on."""


def parts_of(instances: str, config: Path | None) -> list[Part]:
    """Services named with commas between, with the settings of a profile, or on their defaults.

    Raises UnknownServiceError, ConfigError, and ReplayError for a service that has to be
    configured and is not.
    """
    prepare(state_dir(os.environ), os.environ)
    profile = None if config is None else load_host(config, os.environ)
    parts = []
    for instance in dict.fromkeys(name.strip() for name in instances.split(",")):
        service = load_service(service_name(instance))
        settings = _defaults(service.config, instance) if profile is None else profile.service_config(instance, service)
        parts.append(Part(service, settings, instance))
    return parts


def _defaults(config: type[Any], instance: str) -> msgspec.Struct:
    try:
        settings: msgspec.Struct = msgspec.convert({}, config)
    except msgspec.ValidationError as error:
        msg = f"{instance} does not run on its defaults ({error}): give a profile with --config"
        raise ReplayError(msg) from error
    return settings


def place_of(text: str) -> Place:
    """Place written as 'line/kind/name'. Raises TopicError."""
    chunks = text.split("/")
    for kind in PLACE_KINDS:
        if len(chunks) == 3 and chunks[1] == kind:  # noqa: PLR2004 - line, kind, name
            return Place(chunks[0], kind, chunks[2])
    msg = f"{text!r} is no place: write line/kind/name, kind one of {', '.join(PLACE_KINDS)}"
    raise TopicError(msg)


def run_offline_replay(
    file: Path, parts: list[Part], out: Path, key_expression: str | None, place: Place | None
) -> Replayed:
    """Replay `file` through services, everything that they publish going to `out`.

    Raises ReplayError, RecordingError, OSError; `out` is then as it was before.
    """
    begun_s = time.monotonic()
    starts_s: list[float] = []
    file_out = PartFile(out, overwrite=True)
    try:
        writer = RecordingWriter(file_out)

        def keep(sample: Sample) -> None:
            writer.write(sample)
            if file_out.pending_bytes >= COMMIT_BYTES:
                file_out.commit()

        done = replay(
            _told(file, key_expression), parts, keep, place, lambda: starts_s.append(time.monotonic() - begun_s)
        )
        _require_fed(done, file)
        writer.finish()
        file_out.complete()
    except BaseException:
        file_out.discard()
        raise
    start_s = starts_s[0]
    took_s = time.monotonic() - begun_s - start_s
    return Replayed(done.fed, done.left_out, writer.messages, done.elapsed_s, start_s, took_s)


def _require_fed(done: OfflineReplay, file: Path) -> None:
    if not done.fed:
        msg = f"{file}: nothing in it is read by {', '.join(part.instance for part in done.parts)}"
        raise ReplayError(msg)


def _told(file: Path, key_expression: str | None) -> Iterator[Sample]:
    """Samples of a file; says how far it is."""
    line = ProgressLine(time.monotonic)
    total = message_count(file)
    for number, sample in enumerate(read_recording(file, key_expression)):
        if number % TOLD_EVERY == 0:
            line.update(partial(_share, number, total))
        yield sample
    line.done()


def _share(number: int, total: int) -> str:
    return f"{number} of {total} messages, {100 * number / max(total, 1):.0f} %"
