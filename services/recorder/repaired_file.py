"""Recordings that ended without their end: what can be read is saved into a complete file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from services.recorder.file_names import DAMAGED_SUFFIX, PART_SUFFIX
from services.recorder.mcap_file import RecordingWriter
from services.recorder.part_file import PartFile
from services.recorder.recording_file import Fault, Scanner, lanes_in_summary

FAULTS_NAMED = 10
COMMIT_BYTES = 8 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class Repair:
    """What became of one file."""

    path: Path
    """The file that was looked at."""
    outcome: Literal["complete", "repaired", "empty", "hopeless"]
    """Nothing was wrong; saved; nothing was in it (deleted if it was a `.part`); nothing can be read (kept)."""
    output: Path | None
    """Where the complete recording is now."""
    kept: Path | None
    """Where the broken file is kept, if more than its end was missing."""
    messages: int
    lost_messages: int
    """Known to be lost with damaged chunks; what a missing end held cannot be known."""
    lost_bytes: int
    """At the end of the file."""
    faults: tuple[str, ...]
    """The first ten, in words."""


def repair(path: Path) -> Repair:
    """Save what can be read of a recording: rewritten beside, then renamed.

    `X.mcap.part` becomes `X.mcap`; any other file keeps its name. The broken file is kept as
    `….damaged` if more than its end was missing. Raises OSError (no room, no permission,
    `X.mcap` is there already); then everything is as it was.
    """
    target = path.with_name(path.name.removesuffix(".part")) if path.name.endswith(PART_SUFFIX) else path
    if target != path and target.exists():
        msg = f"{target} is there already; move it away to repair {path}"
        raise FileExistsError(msg)
    beside = PartFile(path.with_name(f"{path.name}.repaired"), overwrite=True)
    try:
        scanner, faults = _copy(path, beside)
        if not scanner.messages or not faults:
            beside.discard()
        else:
            beside.complete()
    except BaseException:
        beside.discard()
        raise
    return _settle(path, target, beside.final, scanner, faults)


def _copy(path: Path, beside: PartFile) -> tuple[Scanner, list[Fault]]:
    faults: list[Fault] = []
    writer = RecordingWriter(beside)
    with path.open("rb") as stream:
        scanner = Scanner(stream, faults.append, lanes_in_summary(stream))
        for sample in scanner.samples():
            writer.write(sample)
            if beside.pending_bytes >= COMMIT_BYTES:
                beside.commit()
    writer.finish()
    return scanner, faults


def _settle(path: Path, target: Path, beside: Path, scanner: Scanner, faults: list[Fault]) -> Repair:
    lost_bytes = path.stat().st_size - scanner.whole_bytes
    only_the_end = all(fault.is_end for fault in faults)
    outcome: Literal["complete", "repaired", "empty", "hopeless"] = "complete"
    output: Path | None = target
    kept: Path | None = None
    if not faults:
        path.replace(target)
    elif scanner.messages:
        outcome = "repaired"
        if not only_the_end:
            kept = path.replace(path.with_name(path.name + DAMAGED_SUFFIX))
        beside.replace(path)
        path.replace(target)
    elif path != target and only_the_end and not lost_bytes:
        outcome, output = "empty", None
        path.unlink()
    else:
        outcome, output, kept = "hopeless", None, path
    named = tuple(f"byte {fault.offset}: {fault.what}" for fault in faults[:FAULTS_NAMED])
    return Repair(path, outcome, output, kept, scanner.messages, scanner.lost_messages, lost_bytes, named)
