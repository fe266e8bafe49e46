from __future__ import annotations

import pytest

from services.radio_anomaly.precursor import DAY_NS, Point, Trend, drifts, expected_loss, held_back, trend_of
from services.radio_anomaly.settings import Settings

STREAM = ("power", "W1", "ch1")


def falling(count: int, per_day: float, information: float = 4.0) -> list[Point]:
    return [Point(k * DAY_NS // 2, per_day * k / 2.0 * information, information, 0.0) for k in range(count)]


def test_the_level_of_a_steady_change_is_that_change() -> None:
    series = [Point(k * DAY_NS, -2.0 * 4.0, 4.0, 0.0) for k in range(8)]
    trend = trend_of(STREAM, (0, 0), series, Settings())
    assert trend is not None
    assert trend.level == pytest.approx(-2.0)
    assert trend.slope_per_day == pytest.approx(0.0, abs=1e-12)
    assert not drifts(trend, Settings()), "it does not go on"
    assert held_back(trend, Settings()), "but it is not to become the normal"


def test_the_spread_of_the_level_is_that_of_an_ewma() -> None:
    series = [Point(k * DAY_NS, -4.0, 1.0, 0.0) for k in range(200)]
    trend = trend_of(STREAM, (0, 0), series, Settings())
    assert trend is not None
    # Var of an EWMA in the long run: λ / (2 - λ).
    assert trend.level / trend.score == pytest.approx((0.3 / 1.7) ** 0.5, rel=1e-6)


def test_a_fall_of_a_decibel_a_day_drifts_and_its_slope_is_exact() -> None:
    trend = trend_of(STREAM, (0, 0), falling(10, -1.0), Settings())
    assert trend is not None
    assert trend.slope_per_day == pytest.approx(-1.0)
    assert drifts(trend, Settings())


def test_too_few_passes_or_too_short_a_time_tell_nothing() -> None:
    assert trend_of(STREAM, (0, 0), falling(3, -1.0), Settings()) is None
    minute = [Point(k * 10**9, -4.0, 1.0, 0.0) for k in range(8)]
    assert trend_of(STREAM, (0, 0), minute, Settings()) is None


def slope(per_day: float, deviation: float) -> Trend:
    return Trend(
        quantity="power",
        radio="W1",
        channel="ch1",
        start=0,
        length=0,
        score=-6.0,
        level=-3.0,
        slope_per_day=per_day,
        slope_deviation=deviation,
        points=8,
        since_ns=0,
    )


def test_the_day_of_loss_is_the_margin_over_the_slope() -> None:
    loss = expected_loss(slope(-1.0, 0.1), 12.0, 5 * DAY_NS)
    assert loss is not None
    assert loss.expected_ns == 17 * DAY_NS
    assert loss.early_ns == 5 * DAY_NS + round(12.0 / 1.1645 * DAY_NS)
    assert loss.late_ns == 5 * DAY_NS + round(12.0 / 0.8355 * DAY_NS)


def test_a_loss_may_never_come_and_may_be_here_already() -> None:
    unsure = expected_loss(slope(-1.0, 1.0), 12.0, 0)
    assert unsure is not None
    assert unsure.late_ns is None
    here = expected_loss(slope(-1.0, 0.1), -2.0, 7)
    assert here is not None
    assert here.expected_ns == 7
    assert expected_loss(slope(0.5, 0.1), 12.0, 0) is None


def test_better_reception_and_fewer_corrected_bits_are_no_trend_worth_a_word() -> None:
    for quantity, worse in (("reception", -1.0), ("bits", 1.0)):
        for way in (-1.0, 1.0):
            series = [Point(k * DAY_NS // 2, way * k / 2.0 * 4.0, 4.0, 0.0) for k in range(10)]
            trend = trend_of((quantity, "W1", "ch1"), (0, 0), series, Settings())
            assert trend is not None
            assert drifts(trend, Settings()) == (way == worse)
