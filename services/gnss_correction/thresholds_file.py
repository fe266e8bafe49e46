"""Thresholds files: TOML, read strictly and written beside their place, then renamed."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import msgspec

from schemas.thresholds import Thresholds


def read_thresholds(path: Path) -> Thresholds:
    """Thresholds in a file. Raises ValueError that names the file and the field, OSError."""
    try:
        return msgspec.convert(tomllib.loads(path.read_text("utf-8")), Thresholds)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, msgspec.ValidationError) as error:
        msg = f"{path}: {error}"
        raise ValueError(msg) from error


def thresholds_text(thresholds: Thresholds) -> str:
    """Thresholds as TOML.

    >>> from schemas.thresholds import Band
    >>> band = Band(system="G", lowest_deg=0.0, highest_deg=90.0, threshold_m=0.6)
    >>> print(thresholds_text(Thresholds(receiver="r1", bands=(band,))).splitlines()[1])
    receiver = "r1"
    """
    whole = msgspec.to_builtins(thresholds)
    bands = whole.pop("bands")
    tables = [_lines(whole), *(["", "[[bands]]", *_lines(band)] for band in bands)]
    return "\n".join(line for table in tables for line in table) + "\n"


def _lines(table: dict[str, object]) -> list[str]:
    # A JSON string, integer or float is one of TOML too, but for the delete character, which TOML wants escaped.
    return [
        f"{name} = {json.dumps(value, ensure_ascii=False)}".replace("\x7f", "\\u007f")
        for name, value in table.items()
        if value is not None
    ]


def write_thresholds(path: Path, thresholds: Thresholds) -> None:
    """Write a thresholds file. Raises OSError; then nothing is left behind."""
    beside = path.with_name(f".{path.name}.part")
    try:
        beside.write_text(thresholds_text(thresholds), "utf-8")
        beside.replace(path)
    except OSError:
        beside.unlink(missing_ok=True)
        raise
