"""Lines of numbers, as loggers and microcontrollers write them: separated by commas, semicolons or spaces.

Which column is what is configuration; a line that does not have the columns, or no number in one of
them, is counted and left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from services.motion_sensors.imu_sample import ImuSample, new_counts

_LONGEST: Final = 1024
LARGEST: Final = 2.0**53
"""Whole numbers beyond are not exact any more, as counts must be; and no sensor measures so much."""
IMU_COLUMNS: Final = ("t_s", "ax_mps2", "ay_mps2", "az_mps2", "gx_radps", "gy_radps", "gz_radps")


class NumberRows:
    """Finds lines and their wanted columns."""

    def __init__(self, columns: Sequence[str], wanted: Sequence[str]) -> None:
        """Know the columns of a line by name. Raises ValueError when a wanted one is missing."""
        missing = [name for name in wanted if name not in columns]
        if missing:
            msg = f"no column {', '.join(missing)} among {', '.join(columns)}"
            raise ValueError(msg)
        self._places = [columns.index(name) for name in wanted]
        self._rest = b""
        self.counts = new_counts()

    def feed(self, chunk: bytes) -> list[tuple[float, ...]]:
        """Wanted columns of every line that the bytes complete."""
        *lines, rest = (self._rest + chunk).split(b"\n")
        self._rest = rest if len(rest) <= _LONGEST else b""
        self.counts["skipped_bytes"] += len(rest) - len(self._rest)
        rows = []
        for line in lines:
            row = self._row(line)
            if row:
                rows.append(row)
            elif line.strip():
                self.counts["skipped_bytes"] += len(line)
        self.counts["frames"] += len(rows)
        return rows

    def _row(self, line: bytes) -> tuple[float, ...]:
        """Wanted numbers of a line; none where one is missing or beyond LARGEST, as NaN is."""
        cells = line.replace(b",", b" ").replace(b";", b" ").split()
        try:
            row = tuple(float(cells[place]) for place in self._places)
        except (IndexError, ValueError):
            return ()
        return row if all(abs(one) <= LARGEST for one in row) else ()


class ImuRows:
    """Samples of an inertial sensor from lines of numbers (IMU_COLUMNS; `t_s` may be left out)."""

    counter_modulus = 0

    def __init__(self, columns: Sequence[str] = IMU_COLUMNS) -> None:
        """Know the columns. Raises ValueError when one is missing."""
        self._timed = "t_s" in columns
        self._rows = NumberRows(columns, IMU_COLUMNS if self._timed else IMU_COLUMNS[1:])
        self.counts = self._rows.counts

    def feed(self, chunk: bytes) -> list[ImuSample]:
        """Samples that the bytes complete."""
        rows = self._rows.feed(chunk)
        return [ImuSample(row[1:], device_s=row[0]) if self._timed else ImuSample(row) for row in rows]
