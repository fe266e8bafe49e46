"""The file of stored coefficients: whole or not at all, also after kill -9 and power cuts."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

import msgspec

from schemas.track_circuit import CoefficientStore

LARGEST_BYTES: Final = 16 * 1024 * 1024


class StoreError(ValueError):
    """A file of coefficients that cannot be used: path and why."""


def store_path(folder: Path) -> Path:
    """The file below the state folder."""
    return folder / "track_circuit" / "coefficients.json"


def read_store(path: Path) -> CoefficientStore:
    """All sets; none where there is no file. Raises StoreError and OSError."""
    try:
        with path.open("rb") as file:
            text = file.read(LARGEST_BYTES + 1)
    except FileNotFoundError:
        return CoefficientStore()
    if len(text) > LARGEST_BYTES:
        msg = f"{path}: larger than {LARGEST_BYTES} bytes"
        raise StoreError(msg)
    try:
        return msgspec.json.decode(text, type=CoefficientStore)
    except msgspec.DecodeError as error:
        msg = f"{path}: {error}"
        raise StoreError(msg) from error


def write_store(path: Path, store: CoefficientStore) -> None:
    """Put the sets beside, then in place of the ones before. Raises OSError."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.part")
    try:
        with beside.open("wb") as file:
            file.write(msgspec.json.format(msgspec.json.encode(store), indent=1) + b"\n")
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise
