"""Figures of a stretch that events carry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from services.radio_anomaly.precursor import Trend
from services.radio_anomaly.stream_state import View


def band(view: View, rows: slice, k: float) -> tuple[float, float, float]:
    """Mean measured over a window, and the mean of its sections' A - kσ and A + kσ."""
    residuals = view.residuals
    expected = view.values[rows] - residuals.residual[rows]
    deviation = np.sqrt(residuals.mean_variance[rows] + residuals.variance[rows])
    return (
        float(view.values[rows].mean()),
        float((expected - k * deviation).mean()),
        float((expected + k * deviation).mean()),
    )


def clearest(trends: Sequence[Trend]) -> list[Trend]:
    """One trend a stretch: the whole line rather than its parts, else the clearer of two that overlap."""
    ordered = sorted(trends, key=lambda one: (one.length != 0, -abs(one.score), one.quantity, one.start))
    kept: list[Trend] = []
    for one in ordered:
        if not any(
            (other.radio, other.channel) == (one.radio, one.channel)
            and (other.length == 0 or (one.start < other.start + other.length and other.start < one.start + one.length))
            for other in kept
        ):
            kept.append(one)
    return kept


def change_over(view: View | None, stretch: tuple[int, int]) -> float | None:
    """Mean residual over a stretch; None where nothing was measured."""
    if view is None:
        return None
    rows = view.over(*stretch) if stretch[1] else slice(0, len(view.values))
    return float(view.residuals.residual[rows].mean()) if rows.stop > rows.start else None
