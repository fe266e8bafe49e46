"""Run records out of the events that hold them, a column a field."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import msgspec

from schemas.codec import decode_json
from schemas.runs import RunRecord
from services.cloud_analyzer.tables import Value

SENDER: Final = ("taken_ns", "clock", "line", "place", "source", "boot_id", "sequence")
"""Columns of the event that are kept beside the record's own."""
COLUMNS: Final = (*SENDER, *(field.name for field in msgspec.structs.fields(RunRecord)))


def run_rows(columns: tuple[str, ...], rows: Sequence[Sequence[Value]]) -> tuple[tuple[Value, ...], ...]:
    """Rows of `events` about runs as rows of COLUMNS."""
    before = [columns.index(name) for name in SENDER]
    at = columns.index("message")
    return tuple(
        (*(row[index] for index in before), *msgspec.structs.astuple(decode_json(RunRecord, str(row[at]))))
        for row in rows
    )
