"""Speeds of legs on disk while a report is made, so that thousands of runs do not have to fit into memory."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Self

import numpy as np

from services.run_history.speed_trace import SpeedTrace

COLUMNS = 3


@dataclass(frozen=True, slots=True)
class _Entry:
    run_id: str
    departure_s: float
    first: int
    """Number of its first row in the section's file."""
    rows: int


class TraceStore:
    """Traces by section, in a folder of its own that goes when the store is closed."""

    def __init__(self) -> None:
        """Make the folder. Raises OSError."""
        self._folder = TemporaryDirectory(prefix="kirotei-traces-")
        self._entries: dict[tuple[str, str], list[_Entry]] = {}

    def __enter__(self) -> Self:
        """Give the store."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Remove the folder."""
        self._folder.cleanup()

    def put(self, start: str, end: str, trace: SpeedTrace) -> None:
        """Append a trace of the section from `start` to `end`. Raises OSError."""
        entries = self._entries.setdefault((start, end), [])
        first = entries[-1].first + entries[-1].rows if entries else 0
        rows = np.column_stack((trace.way_m, trace.time_s, trace.speed_mps)).astype("<f8")
        with self._path(start, end).open("ab") as file:
            file.write(rows.tobytes())
        entries.append(_Entry(trace.run_id, trace.departure_s, first, len(rows)))

    def of(self, start: str, end: str) -> list[SpeedTrace]:
        """Traces of a section in the order they came. Raises OSError."""
        entries = self._entries.get((start, end), [])
        if not entries:
            return []
        table = np.fromfile(self._path(start, end), dtype="<f8").reshape(-1, COLUMNS)
        found = []
        for one in entries:
            way, time, speed = (np.ascontiguousarray(column) for column in table[one.first : one.first + one.rows].T)
            found.append(SpeedTrace(one.run_id, one.departure_s, way, time, speed))
        return found

    def _path(self, start: str, end: str) -> Path:
        # Names of stations may hold anything; files are called by the number of their section.
        return Path(self._folder.name, f"{list(self._entries).index((start, end))}.f8")
