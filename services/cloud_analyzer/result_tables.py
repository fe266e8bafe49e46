"""Tables of what the cloud itself made of its history: models of the radio, and what they found in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from services.cloud_analyzer.tables import Table, Value

MODELS: Final = Table(
    "models",
    (
        ("taken_ns", "bigint"),
        ("line", "varchar"),
        ("version", "varchar"),
        ("based_on", "varchar"),
        ("method", "varchar"),
        ("from_ns", "bigint"),
        ("through_ns", "bigint"),
        ("first_utc", "varchar"),
        ("last_utc", "varchar"),
        ("passes", "bigint"),
        ("readings", "bigint"),
        ("held_out_sections", "bigint"),
        ("false_alarm_rate", "double"),
        ("false_alarm_rate_high", "double"),
        ("bytes", "bigint"),
        ("sha256", "varchar"),
        ("parts", "bigint"),
    ),
    order=("taken_ns", "version"),
    shard_by="version",
)
"""A row a model: when it was made (`taken_ns`), from what, and how often it cries wolf."""
MODEL_PARTS: Final = Table(
    "model_parts",
    (("taken_ns", "bigint"), ("line", "varchar"), ("version", "varchar"), ("part", "bigint"), ("content", "varchar")),
    order=("version", "part"),
    shard_by="version",
)
"""Content of models: base64 of the model's file, packed by gzip, cut into parts."""
REANALYSED: Final = Table(
    "reanalysed",
    (
        ("taken_ns", "bigint"),
        ("line", "varchar"),
        ("model", "varchar"),
        ("analysis", "varchar"),
        ("number", "bigint"),
        ("event_id", "varchar"),
        ("phase", "varchar"),
        ("kind", "varchar"),
        ("cause", "varchar"),
        ("radio", "varchar"),
        ("channel", "varchar"),
        ("direction", "varchar"),
        ("chainage_m", "double"),
        ("section_end_m", "double"),
        ("confirmed", "bigint"),
        ("pass_id", "varchar"),
        ("message", "varchar"),
    ),
    order=("taken_ns", "analysis", "number"),
    shard_by="analysis",
)
"""Events that a model found in the history; `analysis` names model, time and history that they came of."""
RESULTS: Final = (MODEL_PARTS, MODELS, REANALYSED)
"""In the order of writing: a model is listed once all of it is there."""


@dataclass(frozen=True, slots=True)
class Findings:
    """What is to be kept of one piece of work."""

    models: tuple[tuple[Value, ...], ...] = ()
    model_parts: tuple[tuple[Value, ...], ...] = ()
    reanalysed: tuple[tuple[Value, ...], ...] = ()

    def of(self, table: Table) -> list[tuple[Value, ...]]:
        """Rows of a table."""
        return list({"models": self.models, "model_parts": self.model_parts, "reanalysed": self.reanalysed}[table.name])
