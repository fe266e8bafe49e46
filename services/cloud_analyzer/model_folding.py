"""Models made small enough for a message: sums of neighbouring days added up, for sums merge."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import date

import msgspec

from schemas.radio import BinSums
from services.cloud_analyzer.model_rows import packed_model
from services.radio_anomaly.passes import day_of
from services.radio_anomaly.radio_model import RadioModel

WIDEST_DAYS = 64
"""Against the half-life of what was learned (120 days) a weight is off by no more than a fifth then."""


def folded(model: RadioModel, width_days: int) -> RadioModel:
    """The model with its sums by so many days instead of one; days stay apart where a new normal was accepted."""
    since = sorted({day_of(word.since_ns) for word in model.acceptances})

    def fold(rows: Iterable[BinSums]) -> tuple[BinSums, ...]:
        kept: dict[tuple[object, ...], BinSums] = {}
        for row in rows:
            period = (date.fromisoformat(row.day).toordinal() // width_days, sum(day <= row.day for day in since))
            key = (row.quantity, row.radio, row.channel, row.direction, row.section, row.cell, *period)
            before = kept.get(key)
            kept[key] = row if before is None else _added(before, row)
        return tuple(kept.values())

    return msgspec.structs.replace(model, sums=fold(model.sums), withheld=fold(model.withheld))


def _added(one: BinSums, other: BinSums) -> BinSums:
    """Both as of the later day."""
    return msgspec.structs.replace(
        one,
        day=max(one.day, other.day),
        n=one.n + other.n,
        sum=one.sum + other.sum,
        sum_squares=one.sum_squares + other.sum_squares,
    )


def fitting(model: RadioModel, most_bytes: int) -> tuple[bytes, int]:
    """Packed content of at most so many bytes, and by how many days its sums are then. Raises ValueError."""
    width_days = 1
    while width_days <= WIDEST_DAYS:
        packed = packed_model(folded(model, width_days) if width_days > 1 else model)
        if len(packed) <= most_bytes:
            return packed, width_days
        width_days *= 2
    msg = f"the model has {len(packed)} bytes even by {WIDEST_DAYS} days, more than a message carries ({most_bytes})"
    raise ValueError(msg)
