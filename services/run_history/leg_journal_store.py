"""The leg under way on disk: where it began and every position since, so that a restart goes on with it.

One line for what was known when the journal was begun, one for each position after that. Lines are handed to the
system as they come: kill -9 loses nothing, a power cut the last seconds. A line that was cut short ends the journal.
"""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from services.run_history.live_runs import LegBegun, PlaceSeen

LARGEST_BYTES: Final = 4_000_000


class JournalError(ValueError):
    """A journal that cannot be used: path and why."""


def journal_file(folder: Path, line: str, train: str) -> Path:
    """File of one train."""
    safe = re.sub(r"[^A-Za-z0-9_.-]", "_", f"{line}-{train}")
    return folder / "run_history" / f"{safe}-{zlib.crc32(f'{line}/{train}'.encode()):08x}.jsonl"


def begin_journal(path: Path, begun: LegBegun, places: Sequence[PlaceSeen]) -> None:
    """Put a journal of a leg in place of the one before, whole or not at all. Raises OSError."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    beside = path.with_name(path.name + ".new")
    with beside.open("wb") as file:
        file.writelines(msgspec.json.encode(one) + b"\n" for one in (begun, *places))
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)


def add_place(path: Path, place: PlaceSeen) -> None:
    """Add a position. Raises OSError."""
    with path.open("ab") as file:
        file.write(msgspec.json.encode(place) + b"\n")


def read_journal(path: Path) -> tuple[LegBegun, list[PlaceSeen]] | None:
    """What was begun and the positions since; None where there is no journal. Raises JournalError, OSError."""
    try:
        with path.open("rb") as file:
            lines = file.read(LARGEST_BYTES).split(b"\n")[:-1]
    except FileNotFoundError:
        return None
    places: list[PlaceSeen] = []
    try:
        begun = msgspec.json.decode(lines[0] if lines else b"", type=LegBegun)
    except msgspec.DecodeError as error:
        msg = f"{path}: no journal of a leg: {error}"
        raise JournalError(msg) from error
    for line in lines[1:]:
        try:
            places.append(msgspec.json.decode(line, type=PlaceSeen))
        except msgspec.DecodeError:
            break
    return begun, places
