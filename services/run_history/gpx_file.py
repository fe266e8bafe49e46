"""GPX 1.0 and 1.1 tracks: a run for each `trk`; a speed where the file states one, else none."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import BinaryIO
from xml.etree import ElementTree as ET

import numpy as np

from services.run_history.fixes import RunLog, run_log

HEAD_BYTES = 4096


class GpxError(ValueError):
    """A file that is no GPX: path, line, why."""


def read_gpx(path: Path) -> Iterator[RunLog]:
    """Runs of a file. Raises GpxError naming the line, OSError."""
    with path.open("rb") as file:
        if b"<!DOCTYPE" in file.read(HEAD_BYTES):  # entities could be made to grow without bound
            msg = f"{path}: a document type is not accepted in GPX"
            raise GpxError(msg)
        file.seek(0)
        try:
            yield from _tracks(path, file)
        except ET.ParseError as error:
            msg = f"{path}:{error.position[0]}: {error}"
            raise GpxError(msg) from error


def _tracks(path: Path, file: BinaryIO) -> Iterator[RunLog]:
    rows: list[tuple[float, float, float, float]] = []
    number = points = 0
    for _, element in ET.iterparse(file, events=("end",)):  # noqa: S314 - document types are refused above
        match _name(element.tag):
            case "trkpt":
                rows.append(_point(element))
                points += 1
                element.clear()
            case "trk":
                number += 1
                if rows:
                    named = next((one.text for one in element if _name(one.tag) == "name" and one.text), None)
                    columns = np.array(rows, dtype=np.float64).T
                    yield run_log(f"{path.stem}-{number}" if named is None else named.strip(), *columns)
                rows = []
                element.clear()
    if points == 0:
        msg = f"{path}: no {'point (trkpt) in its tracks' if number else 'track (trk) in this file'}"
        raise GpxError(msg)


def _name(tag: str) -> str:
    return tag.rpartition("}")[2]


def _point(element: ET.Element) -> tuple[float, float, float, float]:
    time_s = speed_mps = math.nan
    for part in element.iter():
        name = _name(part.tag)
        if name == "time" and part.text:
            time_s = _seconds(part.text.strip())
        elif name == "speed" and part.text:
            speed_mps = _number(part.text)
    return time_s, _number(element.get("lat")), _number(element.get("lon")), speed_mps


def _seconds(text: str) -> float:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return math.nan
    return moment.timestamp() if moment.tzinfo is not None else math.nan


def _number(text: str | None) -> float:
    try:
        return math.nan if text is None else float(text)
    except ValueError:
        return math.nan
