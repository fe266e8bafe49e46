"""Stretches that are off their mean now: windows judged over this pass and the two before it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import msgspec
import numpy as np

from services.radio_anomaly.settings import Settings
from services.radio_anomaly.window_test import WHOLE, PassTest, Residuals, WindowSum, whole_sum

BEFORE = 2
"""Earlier passes over a window that are remembered."""
LASTING_SHARE = 0.5
"""Of the learned means' error, what is the same on every pass: that of the passes which were learned. The rest is the
serving cell's own, which may be another one next time."""

Stream = tuple[str, str, str]
"""Quantity, radio, channel."""
LEAST_CHANGE_FACTOR = {"power": 1.0, "decoded": 1.0, "reception": 0.1}
"""Quantities whose windows are tested, and their least change as a multiple of that in dB. For reception 0.3 on the
transformed scale: from 98 % to 92 %, for one."""


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """A stretch off its mean."""

    quantity: str
    radio: str
    channel: str
    start: int
    """First section,"""
    length: int
    """and how many."""
    score: float
    """In standard deviations, signed."""
    change: float
    """On the quantity's scale, signed."""
    passes: int
    """That speak for it."""
    confirmed: bool

    def overlaps(self, start: int, length: int) -> bool:
        """Whether it shares a section."""
        return self.start < start + length and start < self.start + self.length


class WindowMemory:
    """What the last passes said of each window."""

    def __init__(self) -> None:
        """Of nothing."""
        self.kept: dict[tuple[str, str, str, int, int], tuple[tuple[float, float], ...]] = {}

    def before(self, stream: Stream, start: int, length: int) -> tuple[tuple[float, float], ...]:
        """Pull and information, newest last."""
        return self.kept.get((*stream, start, length), ())

    def put(self, stream: Stream, sums: Iterable[WindowSum]) -> None:
        """Remember a pass."""
        for one in sums:
            key = (*stream, one.start, one.length)
            self.kept[key] = (*self.kept.get(key, ())[1 - BEFORE :], (one.pull, one.information))


def window_sums(tests: Sequence[PassTest], settings: Settings) -> list[WindowSum]:
    """Every window of a pass, the whole of it among them."""
    found = [one for test in tests for one in test.windows(settings.windows)]
    whole = whole_sum(tests)
    return found if whole is None else [*found, whole]


def find_steps(
    stream: Stream, sums: Iterable[WindowSum], residuals: Residuals, memory: WindowMemory, settings: Settings
) -> list[Finding]:
    """Windows off their mean, the clearest first, none overlapping a clearer one.

    The plain mean of the window's residuals has to agree with the estimate: a change against the rest of the pass alone
    is the rest's.

    Confirmed: this pass alone is beyond `certain_score` (`certain_wide_score` where `certain` says so), or two or three
    passes together are beyond `confirmed_score` with each of them pointing the same way. Not confirmed: this pass is
    beyond `suspect_score`.
    """
    least = settings.least_change_db * LEAST_CHANGE_FACTOR[stream[0]]
    found = [
        finding
        for one in sums
        if abs(one.pull) >= settings.each_score * math.sqrt(one.information)
        if (finding := _judge(stream, one, memory.before(stream, one.start, one.length), settings, least)) is not None
    ]
    low, high = int(residuals.sections[0]), int(residuals.sections[-1])
    found = [
        one if one.length != WHOLE else msgspec.structs.replace(one, start=low, length=high - low + 1) for one in found
    ]
    found = [one for one in found if agrees(residuals, (one.start, one.length), one.change)]
    found.sort(key=lambda one: (not one.confirmed, -abs(one.score), one.start, one.length))
    taken: set[int] = set()
    kept = []
    for one in found:
        sections = range(one.start, one.start + one.length)
        if taken.isdisjoint(sections):
            taken.update(sections)
            kept.append(one)
    return kept


def certain(one: WindowSum, settings: Settings) -> float:
    """Score from which one pass is enough.

    Lower over sections that are many and well known: what one section does beyond a normal distribution (a bridge,
    another cell) is lost among them, and their mean is measured, not expected. Higher over the whole pass, whose level
    may be the pass's own: of the day, the train, the weather.
    """
    if one.length == WHOLE:
        return max(settings.certain_score, settings.certain_whole_score)
    wide = one.observed >= settings.wide_sections and one.learned_passes >= settings.wide_passes
    return min(settings.certain_score, settings.certain_wide_score) if wide else settings.certain_score


def _judge(
    stream: Stream, one: WindowSum, before: tuple[tuple[float, float], ...], settings: Settings, least: float
) -> Finding | None:
    sign = math.copysign(1.0, one.pull)
    pull, information, squares = one.pull, one.information, one.information**2
    alone = abs(pull) / math.sqrt(information)
    enough = abs(pull / information) >= least
    best = (alone, pull / information, 1, alone >= certain(one, settings) and enough)
    if not best[3] and not (alone >= settings.suspect_score and enough):
        best = (0.0, 0.0, 0, False)
    for number, (earlier_pull, earlier_information) in enumerate(reversed(before), start=2):
        if sign * earlier_pull < settings.each_score * math.sqrt(earlier_information):
            break
        pull += earlier_pull
        information += earlier_information
        squares += earlier_information**2
        lasting = LASTING_SHARE * one.lasting_variance * (1.0 - squares / information**2)
        together = abs(pull / information) / math.sqrt(1.0 / information + lasting)
        if together >= settings.confirmed_score and abs(pull / information) >= least and together > best[0]:
            best = (together, pull / information, number, True)
    score, change, passes, confirmed = best
    if not passes:
        return None
    return Finding(
        quantity=stream[0],
        radio=stream[1],
        channel=stream[2],
        start=one.start,
        length=one.length,
        score=sign * score,
        change=change,
        passes=passes,
        confirmed=confirmed,
    )


AGREEING_SHARE = 0.5


def agrees(residuals: Residuals, stretch: tuple[int, int], change: float) -> bool:
    """Whether the plain mean of a stretch's residuals is at least half of an estimated change."""
    first, past = np.searchsorted(residuals.sections, (stretch[0], stretch[0] + stretch[1]))
    plain = float(residuals.residual[first:past].mean())
    return plain * math.copysign(1.0, change) >= AGREEING_SHARE * abs(change)
