"""Levels of clear circuits, kept for a restart: whole or not at all. They age quickly, see occupancy.py."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

import msgspec

LARGEST_BYTES: Final = 1 << 20


class KeptReference(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Level of a clear circuit at a time."""

    level_db: float
    t_ns: int


class ReferencesError(ValueError):
    """A file of levels that cannot be used: path and why."""


def references_path(folder: Path, place: str) -> Path:
    """The file of a place below the state folder."""
    return folder / "track_circuit" / f"references-{place}.json"


def read_references(path: Path) -> dict[str, KeptReference]:
    """Levels by circuit; none where there is no file. Raises ReferencesError and OSError."""
    try:
        with path.open("rb") as file:
            text = file.read(LARGEST_BYTES)
    except FileNotFoundError:
        return {}
    try:
        return msgspec.json.decode(text, type=dict[str, KeptReference])
    except msgspec.DecodeError as error:
        msg = f"{path}: {error}"
        raise ReferencesError(msg) from error


def write_references(path: Path, references: dict[str, KeptReference]) -> None:
    """Put them beside, then in place of the ones before. Raises OSError."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.part")
    with beside.open("wb") as file:
        file.write(msgspec.json.encode(references))
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)
