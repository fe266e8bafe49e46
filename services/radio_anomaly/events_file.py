"""events.csv: one row per event and pass on which it was seen."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from schemas.radio import RadioEvent

COLUMNS: Final = (
    "time",
    "pass_id",
    "radio",
    "channel",
    "direction",
    "section_start_m",
    "section_end_m",
    "kind",
    "cause",
    "value_dbm",
    "lower_dbm",
    "upper_dbm",
    "score",
    "confirmed",
    "reason",
    "event_id",
    "phase",
    "expected_loss",
    "expected_loss_early",
    "expected_loss_late",
    "false_alarm_rate",
    "learned_passes",
    "incident_id",
    "incident",
)


def write_events(path: Path, events: Iterable[RadioEvent]) -> None:
    """Write beside, then rename. Events that ended are no rows: their passes were normal. Raises OSError."""
    beside = path.with_name(path.name + ".new")
    with beside.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        table.writerows(row_of(event) for event in events if event.phase != "ended")
    beside.replace(path)


def row_of(event: RadioEvent) -> list[str]:
    """An event as text, in the order of COLUMNS."""
    return [
        time_text(event.t_ns),
        event.pass_id,
        event.radio,
        event.channel,
        event.direction or "",
        f"{event.section_start_m:.0f}",
        f"{event.section_end_m:.0f}",
        event.kind,
        event.cause,
        _figure(event.value_dbm),
        _figure(event.lower_dbm),
        _figure(event.upper_dbm),
        f"{event.score:.2f}",
        str(int(event.confirmed)),
        event.reason,
        event.event_id,
        event.phase,
        *(
            "" if when is None else time_text(when)
            for when in (event.expected_loss_ns, event.expected_loss_early_ns, event.expected_loss_late_ns)
        ),
        "" if event.false_alarm_rate is None else f"{event.false_alarm_rate:.5f}",
        str(event.learned_passes),
        event.incident_id,
        event.incident,
    ]


def time_text(t_ns: int) -> str:
    """ISO 8601, UTC, whole seconds."""
    return datetime.fromtimestamp(t_ns // 1_000_000_000, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"
