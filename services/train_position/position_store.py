"""The state of the position on disk: whole or not at all, also after kill -9 and power cuts."""

from __future__ import annotations

import os
import re
import zlib
from pathlib import Path
from typing import Final

import msgspec

from services.train_position.snapshot import FORMAT, Snapshot

LARGEST_BYTES: Final = 65_536


class StoreError(ValueError):
    """A state file that cannot be used: path and why."""


def state_file(folder: Path, line: str, train: str) -> Path:
    """File of one train."""
    safe = re.sub(r"[^A-Za-z0-9_.-]", "_", f"{line}-{train}")
    return folder / "train_position" / f"{safe}-{zlib.crc32(f'{line}/{train}'.encode()):08x}.json"


def write_snapshot(path: Path, snapshot: Snapshot) -> None:
    """Put the state beside, then in place of the one before. Raises OSError."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    body = msgspec.json.encode(snapshot)
    text = body + b"\n" + f"{zlib.crc32(body):08x}\n".encode()
    beside = path.with_name(path.name + ".new")
    with beside.open("wb") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def read_snapshot(path: Path) -> Snapshot | None:
    """State as it was kept; None where there is none. Raises StoreError for a file that is damaged, OSError."""
    try:
        with path.open("rb") as file:
            text = file.read(LARGEST_BYTES)
    except FileNotFoundError:
        return None
    body, _, check = text.partition(b"\n")
    if check.strip() != f"{zlib.crc32(body):08x}".encode():
        msg = f"{path}: damaged: its checksum is not that of what it holds"
        raise StoreError(msg)
    try:
        snapshot = msgspec.json.decode(body, type=Snapshot)
    except msgspec.DecodeError as error:
        msg = f"{path}: {error}"
        raise StoreError(msg) from error
    if snapshot.format != FORMAT:
        msg = f"{path}: format {snapshot.format}, this version reads {FORMAT}"
        raise StoreError(msg)
    return snapshot
