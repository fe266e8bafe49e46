"""Rows of the table `radio` as rows of passes.csv, which `kirotei radio` learns from and analyses."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import Final

Value = str | float | int | bool | None
COLUMNS: Final = (
    "time",
    "pass_id",
    "radio",
    "channel",
    "direction",
    "chainage_m",
    "power_dbm",
    "cell",
    "decoded_power_dbm",
    "received_ratio",
    "corrected_bits",
    "frequency_offset_hz",
    "temperature_c",
    "tx_power_dbm",
)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def passes_of(
    columns: tuple[str, ...], rows: Sequence[Sequence[Value]]
) -> tuple[tuple[str, ...], list[tuple[Value, ...]]]:
    """Columns and rows of passes.csv. Left out: rows without place, direction or power, or whose clock was wrong."""
    at = {name: columns.index(name) for name in (*COLUMNS[1:6], *COLUMNS[7:], "channel_power_dbm", "taken_ns", "clock")}
    found: list[tuple[Value, ...]] = []
    for row in rows:
        power = row[at["channel_power_dbm"]]
        if power is None:
            power = row[at["decoded_power_dbm"]]
        placed = row[at["chainage_m"]] is not None and row[at["direction"]] in ("up", "down")
        if power is None or not placed or row[at["clock"]]:
            continue
        time = (_EPOCH + timedelta(microseconds=int(row[at["taken_ns"]] or 0) // 1000)).isoformat()
        found.append((time, *(row[at[name]] for name in COLUMNS[1:6]), power, *(row[at[name]] for name in COLUMNS[7:])))
    return COLUMNS, found
