"""landmarks.json (schemas/line.py, LandmarkDatabase): read, checked, written whole."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import msgspec

from schemas.line import Landmark, LandmarkDatabase
from services.landmark_matching.curve_shape import ShapeError, shape_of_landmark

LARGEST_BYTES: Final = 64_000_000


class LandmarksFileError(ValueError):
    """A file that holds no landmark database: path, what is wrong."""


def read_landmarks(path: Path) -> LandmarkDatabase:
    """Read a database; every landmark's rows are checked. Raises LandmarksFileError, OSError."""
    if path.stat().st_size > LARGEST_BYTES:
        msg = f"{path}: larger than {LARGEST_BYTES // 1_000_000} MB"
        raise LandmarksFileError(msg)
    database = _decoded(path)
    if not database.landmarks:
        msg = f"{path}: it holds no landmarks"
        raise LandmarksFileError(msg)
    seen: set[str] = set()
    for number, landmark in enumerate(database.landmarks):
        try:
            shape_of_landmark(landmark)
        except ShapeError as error:
            msg = f"{path}: $.landmarks[{number}]: {error}"
            raise LandmarksFileError(msg) from error
        if landmark.id in seen:
            msg = f"{path}: $.landmarks[{number}]: id {landmark.id!r} occurs twice"
            raise LandmarksFileError(msg)
        seen.add(landmark.id)
    return database


def _decoded(path: Path) -> LandmarkDatabase:
    """Raises LandmarksFileError, also for fields that there are none of: a tolerance misspelt would be the default."""
    try:
        given = msgspec.json.decode(path.read_bytes())
        database = msgspec.convert(given, LandmarkDatabase)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        msg = f"{path}: {error}"
        raise LandmarksFileError(msg) from error
    for number, row in enumerate(given["landmarks"]):
        for name in row.keys() - set(Landmark.__struct_fields__):
            msg = f"{path}: $.landmarks[{number}]: landmarks have no field {name!r}"
            raise LandmarksFileError(msg)
    return database


def write_landmarks(path: Path, database: LandmarkDatabase) -> None:
    """Write beside `path`, then rename. Raises OSError."""
    part = path.with_name(f".{path.name}.part")
    try:
        part.write_bytes(msgspec.json.format(msgspec.json.encode(database), indent=1) + b"\n")
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
