"""How often a model cries wolf: every learning pass judged by a model that has not seen it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from services.radio_anomaly.monitor import Monitor
from services.radio_anomaly.passes import Journey
from services.radio_anomaly.settings import Settings
from services.radio_anomaly.steps import WindowMemory
from services.radio_anomaly.window_test import CLIP, Correlation

FOLDS: Final = 5
PRIOR_PAIRS: Final = 300.0
"""Pairs of sections with which the usual correlation counts beside the one seen."""
FAR_APART: Final = 10
"""Sections over which nothing but the whole pass's share is left."""
LEAST_INFLATION: Final = 0.9
MOST_INFLATION: Final = 3.0
LEAST_CELLS: Final = 100
"""Pass-sections below which a share of false alarms is not told."""


class HeldOut(msgspec.Struct, frozen=True, kw_only=True):
    """What held-out passes showed."""

    folds: int
    passes: int
    cells: int
    """Pass-sections judged,"""
    reported: int
    """and those of them in a confirmed event above or below."""
    rate: float | None
    """Their share; None with too few."""
    rate_high: float | None
    """Upper end of its 95 % range (Wilson 1927), as if sections were independent."""
    correlation: Correlation
    suspicious: tuple[str, ...]
    """Learning passes with a confirmed event: was everything normal there?"""


def held_out(journeys: Sequence[Journey], settings: Settings) -> HeldOut:
    """Cross-validated over passes, blocks of neighbouring passes left out in turn; deterministic."""
    folds = min(FOLDS, len(journeys))
    block = [number * folds // max(len(journeys), 1) for number in range(len(journeys))]
    monitors = []
    for fold in range(folds):
        monitor = Monitor(settings)
        for journey, of in zip(journeys, block, strict=True):
            if of != fold:
                monitor.learn(journey)
        monitors.append(monitor)
    correlation = _correlation(journeys, block, monitors)
    cells = alarms = 0
    suspicious = []
    memory = WindowMemory()
    for journey, of in zip(journeys, block, strict=True):
        monitor = monitors[of]
        monitor.correlation = correlation
        monitor.windows = memory
        judgement = monitor.judge(journey)
        seen, wolf = judgement.cells, judgement.reported
        for stream, sums in judgement.sums.items():
            memory.put(stream, sums)
        cells += len(seen)
        alarms += len(seen & wolf)
        if seen & wolf:
            suspicious.append(journey.pass_id)
    known = cells >= LEAST_CELLS
    return HeldOut(
        folds=folds,
        passes=len(journeys),
        cells=cells,
        reported=alarms,
        rate=alarms / cells if known else None,
        rate_high=wilson_high(alarms, cells) if known else None,
        correlation=correlation,
        suspicious=tuple(suspicious),
    )


def wilson_high(hits: int, trials: int) -> float:
    """Upper end of the 95 % score interval of a share.

    >>> round(wilson_high(0, 100), 4)
    0.037
    """
    z = 1.96
    share = hits / trials
    middle = share + z * z / (2.0 * trials)
    half = z * float(np.sqrt(share * (1.0 - share) / trials + z * z / (4.0 * trials * trials)))
    return min((middle + half) / (1.0 + z * z / trials), 1.0)


def _correlation(journeys: Sequence[Journey], block: Sequence[int], monitors: Sequence[Monitor]) -> Correlation:
    """Spread and correlation of held-out residuals, drawn towards the usual ones."""
    usual = Correlation()
    squares: list[float] = []
    near: defaultdict[str, list[float]] = defaultdict(lambda: [0.0, 0.0])
    for journey, of in zip(journeys, block, strict=True):
        for stream, view in monitors[of].judge(journey).views.items():
            if stream[0] not in ("power", "decoded"):
                continue
            scores = np.clip(np.concatenate([test.z for test in view.tests]), -CLIP, CLIP)
            squares.extend((scores**2).tolist())
            sections = view.residuals.sections
            apart = np.abs(sections[:, None] - sections[None, :])
            product = np.outer(scores, scores)
            for name, pairs in (("near", apart == 1), ("far", apart >= FAR_APART)):
                entry = near[name]
                weight = float(pairs.sum()) / 2.0
                # The many far pairs of one pass say little more than one does about a share of the whole pass.
                scale = 1.0 if name == "near" else min(1.0, len(sections) / max(weight, 1.0))
                entry[0] += scale * float(product[pairs].sum()) / 2.0
                entry[1] += scale * weight
    if not squares:
        return usual
    variance = (sum(squares) + PRIOR_PAIRS) / (len(squares) + PRIOR_PAIRS)

    def share(name: str, prior: float) -> float:
        total, pairs = near[name]
        return float(np.clip((total / variance + PRIOR_PAIRS * prior) / (pairs + PRIOR_PAIRS), 0.0, 0.9))

    fading = float(np.exp(-1.0 / usual.reach))
    whole = share("far", usual.whole)
    beside = share("near", usual.whole + usual.near * fading)
    return Correlation(
        whole=whole,
        near=min(max((beside - whole) / fading, 0.0), 0.95 - whole),
        reach=usual.reach,
        inflation=float(np.clip(np.sqrt(variance), LEAST_INFLATION, MOST_INFLATION)),
    )
