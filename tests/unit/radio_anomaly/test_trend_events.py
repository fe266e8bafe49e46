"""Slow change from passes to events: in words, with its cause and the day on which reception will be too low."""

from __future__ import annotations

import pytest

from schemas.radio import RadioEvent
from services.radio_anomaly.monitor import Monitor
from services.radio_anomaly.passes import binned
from services.radio_anomaly.raising import Evidence, Raiser
from tests.unit.radio_anomaly.made_up import BEGIN_NS, DAY_NS, SETTINGS, at, one_pass


def test_falling_reception_is_told_in_per_cent_and_with_the_day_on_which_it_will_be_too_low() -> None:
    monitor = Monitor(SETTINGS)
    for number in range(24):
        monitor.learn(binned(one_pass(number, ratio=0.99), SETTINGS))
    raiser = Raiser(monitor, Evidence())
    found: list[RadioEvent] = []
    number = 24
    while not found:
        events, _ = raiser.take(binned(one_pass(number, ratio=0.99 - 0.002 * (number - 24)), SETTINGS))
        found = [one for one in events if one.kind == "trend"]
        number += 1
    # 0.4 points a day: the 90 % are reached after 22 days, and the reception was above them when it was told.
    assert number - 24 < 30
    assert found[0].expected_loss_ns is not None
    days = (found[0].expected_loss_ns - BEGIN_NS) / DAY_NS - 12.0
    assert days == pytest.approx(22.0, abs=8.0), "a straight line through a scale that is not straight in per cent"
    assert "points a day" in found[0].reason
    assert "reception is expected below 90%" in found[0].reason
    assert found[0].cause == "device"


def test_a_device_that_grows_warm_is_no_interferer() -> None:
    monitor = Monitor(SETTINGS)

    def take(number: int, warm_c: float) -> list[RadioEvent]:
        rows = [at(one, temperature_c=30.0 + (number % 3) + warm_c) for one in one_pass(number)]
        return raiser.take(binned(rows, SETTINGS))[0]

    raiser = Raiser(monitor, Evidence())
    for number in range(24):
        take(number, 0.0)
    found = [one for number in range(24, 44) for one in take(number, 1.5 * (number - 24)) if one.kind == "trend"]
    assert {one.cause for one in found} == {"device"}
    assert "device temperature of the whole line is +" in found[0].reason
