"""Model files: read whole or not at all, written beside and renamed, so that kill -9 leaves the old one or the new."""

from __future__ import annotations

import os
import zlib
from pathlib import Path

import msgspec

from services.radio_anomaly.radio_model import FORMAT, RadioModel

GZIP_MAGIC = b"\x1f\x8b"
GZIP_WBITS = 31
_DECODER = msgspec.json.Decoder(RadioModel)


class _Version(msgspec.Struct):
    format: int


def read_model(path: Path) -> RadioModel:
    """A model. Raises ValueError for what is none, or one of a newer version; OSError."""
    return decoded_model(path.read_bytes(), str(path))


def decoded_model(content: bytes, path: str) -> RadioModel:
    """The model in a file's content, packed by gzip or not; `path` is for what errors say. Raises ValueError."""
    try:
        text = zlib.decompress(content, GZIP_WBITS) if content.startswith(GZIP_MAGIC) else content
    except zlib.error as error:
        msg = f"{path}: no radio model: {error}"
        raise ValueError(msg) from error
    try:
        found = msgspec.json.decode(text, type=_Version).format
        if found != FORMAT:
            msg = f"{path}: model format {found}, this version reads {FORMAT}"
            raise ValueError(msg)
        return _DECODER.decode(text)
    except msgspec.DecodeError as error:
        msg = f"{path}: no radio model: {error}"
        raise ValueError(msg) from error


def encoded_model(model: RadioModel) -> bytes:
    """Content of a model's file."""
    return msgspec.json.encode(model) + b"\n"


def write_model(path: Path, model: RadioModel) -> None:
    """Put a model beside, then in place of the one before. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(path.name + ".new")
    with beside.open("wb") as file:
        file.write(encoded_model(model))
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
