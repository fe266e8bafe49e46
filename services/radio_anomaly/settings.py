"""How radio is watched: sections, thresholds, memory. One set for every line, radio and channel."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Method = Literal["line", "paper"]


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What decides. The defaults are those that docs/radio_anomaly.md gives figures for."""

    section_m: Annotated[float, Meta(ge=1.0, le=10_000.0)] = 100.0
    """D: length of a section."""
    k: Annotated[float, Meta(ge=1.0, le=20.0)] = 3.0
    """Of the paper's thresholds A ± kσ, and of the band that people are shown."""
    least_samples: Annotated[int, Meta(ge=1, le=100)] = 2
    """In a section on one pass, for it to count."""
    least_passes: Annotated[int, Meta(ge=2, le=100)] = 4
    """Of a radio and channel before anything about it is raised."""
    windows: Annotated[tuple[Annotated[int, Meta(ge=1, le=100)], ...], Meta(min_length=1, max_length=12)] = (
        1, 2, 3, 5, 8, 10,
    )  # fmt: skip
    """Lengths of the spatial windows, in sections."""
    least_change_db: Positive = 3.0
    """A change of the mean over a window that is worth a word."""
    certain_score: Positive = 5.9
    """On one pass, in standard deviations."""
    certain_wide_score: Positive = 4.5
    """The same over `wide_sections` and more that were learned from `wide_passes` in the mean."""
    wide_sections: Annotated[int, Meta(ge=2, le=1000)] = 5
    wide_passes: Positive = 3.0
    certain_whole_score: Positive = 6.3
    """The same over the whole of a pass: a slow fall of the whole line is a trend before it is a step."""
    confirmed_score: Positive = 4.2
    """Of two or three passes together; each of them has at least `each_score`."""
    each_score: Positive = 1.5
    suspect_score: Positive = 3.5
    """On one pass: told unconfirmed, and not learned from."""
    half_life_days: Positive = 120.0
    """Of what was learned."""
    ewma_weight: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.3
    """Of the newest pass in the precursor."""
    trend_score: Positive = 4.0
    """Of the precursor, in its standard deviations."""
    trend_change_db: Positive = 1.5
    trend_window: Annotated[int, Meta(ge=2, le=100)] = 10
    """Sections of the precursor's windows; the whole line is one besides."""
    least_received_ratio: Annotated[float, Meta(gt=0.0, lt=1.0)] = 0.9
    """Reception below this is what a precursor warns of."""
    loss_power_dbm: float | None = None
    """Power at which reception falls to that ratio; None: as learned from powers with their reception."""
    missing_certain: Annotated[int, Meta(ge=2, le=1000)] = 5
    """Neighbouring sections without an expected sample that are certain at once."""
    period_s: Annotated[float, Meta(ge=10.0, le=86_400.0)] = 600.0
    """What counts as one pass for a radio without place."""
