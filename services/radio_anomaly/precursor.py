"""Slow change: an exponentially weighted mean over passes, its slope, and the day on which reception will fall.

With δ_j the change that pass j shows over a window (window_test.py), I_j its information and age a_j in
passes, weights w_j = (1 - λ)^a_j give

    E = Σ w δ I / Σ w I,    var E = Σ w² I / (Σ w I)² + v,

v being the variance of the learned mean, which all passes share (EWMA: Roberts 1959, here with precisions).
The slope is the straight line through the last passes by weighted least squares.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec

from services.radio_anomaly.settings import Settings
from services.radio_anomaly.steps import Stream
from services.radio_anomaly.window_test import PassTest

KEPT: Final = 16
"""Passes remembered of each window."""
SLOPE_POINTS: Final = 10
LEAST_POINTS: Final = 4
LEAST_DAYS: Final = 1.0
SLOPE_SCORE: Final = 2.5
DAY_NS: Final = 86_400_000_000_000
RANGE: Final = 1.645
"""Standard deviations to each side of a range that holds nine times in ten."""
LEAST_CHANGE: Final = {
    "power": 1.0,
    "decoded": 1.0,
    "reception": 0.1,
    "bits": 0.3,
    "frequency": 100.0,
    "temperature": 6.0,
}
"""As multiples of `trend_change_db`: dB, transformed ratio, ln bits, Hz, °C. Smaller ones are not worth a word."""


class Point(msgspec.Struct, frozen=True, gc=False, array_like=True):
    """What one pass said of a window."""

    t_ns: int
    pull: float
    information: float
    shared_variance: float


class Trend(msgspec.Struct, frozen=True, kw_only=True):
    """A window that drifts. `length` 0: the whole line."""

    quantity: str
    radio: str
    channel: str
    start: int
    length: int
    score: float
    level: float
    slope_per_day: float
    slope_deviation: float
    points: int
    since_ns: int


class TrendMemory:
    """The last passes of each of the precursor's windows."""

    def __init__(self) -> None:
        """Of nothing."""
        self.kept: dict[tuple[str, str, str, int, int], tuple[Point, ...]] = {}

    def series(self, stream: Stream, start: int, length: int, point: Point) -> tuple[Point, ...]:
        """As it would be with a further point."""
        return (*self.kept.get((*stream, start, length), ())[1 - KEPT :], point)

    def put(self, stream: Stream, points: dict[tuple[int, int], Point]) -> None:
        """Remember a pass."""
        for (start, length), point in points.items():
            self.kept[(*stream, start, length)] = self.series(stream, start, length, point)


def trend_points(
    tests: Sequence[PassTest], rest: Sequence[PassTest], t_ns: int, settings: Settings
) -> dict[tuple[int, int], Point]:
    """A pass's word on the whole line (0, 0), and on windows half overlapping each other.

    The whole line's is that of the sections in no finding (`rest`), so is that of a window beside one.
    """
    found: dict[tuple[int, int], Point] = {}
    left = {
        (one.start, one.length): one
        for test in rest
        for one in (test.window(number, settings.trend_window) for number in _starts(test, settings))
        if one is not None
    }
    for test in tests:
        for number in _starts(test, settings):
            one = test.window(number, settings.trend_window)
            beside = left.get((number, settings.trend_window))
            if one is not None and beside is not None and beside.observed == one.observed:
                one = beside
            if one is not None:
                # The mean's error over the window: as over the pass, but averaged over fewer sections.
                wider = test.shared_variance * max(len(test.sections) / one.observed, 1.0)
                found[(one.start, one.length)] = Point(t_ns, one.pull, one.information, wider)
    sums = [test.over(0, len(test.sections)) for test in rest]
    information = sum(info for _, info in sums)
    if information:
        shared = max(test.shared_variance for test in rest)
        found[(0, 0)] = Point(t_ns, sum(pull for pull, _ in sums), information, shared)
    return found


def _starts(test: PassTest, settings: Settings) -> list[int]:
    """First sections of the windows that a pass has sections in."""
    half = max(settings.trend_window // 2, 1)
    return sorted({(int(section) // half - k) * half for section in test.sections for k in (0, 1)})


def trend_of(stream: Stream, window: tuple[int, int], series: Sequence[Point], settings: Settings) -> Trend | None:
    """Level and slope of a window; None before there are enough passes."""
    if len(series) < LEAST_POINTS or series[-1].t_ns - series[0].t_ns < LEAST_DAYS * DAY_NS:
        return None
    weights = [(1.0 - settings.ewma_weight) ** age for age in range(len(series))][::-1]
    information = sum(w * p.information for w, p in zip(weights, series, strict=True))
    level = sum(w * p.pull for w, p in zip(weights, series, strict=True)) / information
    variance = sum(w * w * p.information for w, p in zip(weights, series, strict=True)) / information**2
    variance += series[-1].shared_variance
    slope, deviation = slope_of(series[-SLOPE_POINTS:])
    return Trend(
        quantity=stream[0],
        radio=stream[1],
        channel=stream[2],
        start=window[0],
        length=window[1],
        score=level / math.sqrt(variance),
        level=level,
        slope_per_day=slope,
        slope_deviation=deviation,
        points=len(series),
        since_ns=series[-min(len(series), SLOPE_POINTS)].t_ns,
    )


def slope_of(series: Sequence[Point]) -> tuple[float, float]:
    """Change per day and its standard deviation, by weighted least squares; (0, inf) where all is at one time.

    >>> day = 86_400_000_000_000
    >>> slope, deviation = slope_of([Point(k * day, -2.0 * k, 1.0, 0.0) for k in range(5)])
    >>> round(slope, 9), round(deviation, 3)
    (-2.0, 0.316)
    """
    total = sum(p.information for p in series)
    first_ns = series[0].t_ns
    days = [(p.t_ns - first_ns) / DAY_NS for p in series]
    middle = sum(p.information * d for p, d in zip(series, days, strict=True)) / total
    spread = sum(p.information * (d - middle) ** 2 for p, d in zip(series, days, strict=True))
    if spread <= 0.0:
        return 0.0, math.inf
    slope = sum(p.pull * (d - middle) for p, d in zip(series, days, strict=True)) / spread
    return slope, 1.0 / math.sqrt(spread)


WORSE: Final = {"reception": -1.0, "bits": 1.0}
"""Where only one way is bad: its sign."""


def drifts(trend: Trend, settings: Settings) -> bool:
    """Whether it is worth an event: off its mean, going farther the same way, and not simply better."""
    if trend.level * WORSE.get(trend.quantity, trend.level) <= 0.0:
        return False
    least = settings.trend_change_db * LEAST_CHANGE[trend.quantity]
    return (
        abs(trend.score) >= settings.trend_score
        and abs(trend.level) >= least
        and trend.slope_per_day * trend.level > 0.0
        and abs(trend.slope_per_day) >= SLOPE_SCORE * trend.slope_deviation
    )


def held_back(trend: Trend, settings: Settings) -> bool:
    """Whether it may be one, so that what passes show there is not to become the normal."""
    least = settings.trend_change_db * LEAST_CHANGE[trend.quantity]
    return abs(trend.score) >= HOLD_SHARE * settings.trend_score and abs(trend.level) >= HOLD_SHARE * least


HOLD_SHARE: Final = 0.6


class Loss(msgspec.Struct, frozen=True):
    """When reception is expected to fall, Unix ns; `late_ns` None: perhaps never."""

    expected_ns: int
    early_ns: int
    late_ns: int | None


def expected_loss(trend: Trend, margin_db: float, now_ns: int) -> Loss | None:
    """Day on which a falling power has used up its margin above the power at which reception fails.

    `margin_db` is that of today, the fall so far taken off. The range has the slope 1.645 standard deviations
    steeper and flatter. None for a power that does not fall.
    """
    if trend.slope_per_day >= 0.0:
        return None
    margin_db = max(margin_db, 0.0)
    steep = trend.slope_per_day - RANGE * trend.slope_deviation
    flat = trend.slope_per_day + RANGE * trend.slope_deviation
    days = margin_db / -trend.slope_per_day
    late = None if flat >= 0.0 else min(margin_db / -flat, LONGEST_DAYS)
    return Loss(
        now_ns + round(min(days, LONGEST_DAYS) * DAY_NS),
        now_ns + round(min(margin_db / -steep, LONGEST_DAYS) * DAY_NS),
        None if late is None else now_ns + round(late * DAY_NS),
    )


LONGEST_DAYS: Final = 3650.0
