from __future__ import annotations

from services.radio_anomaly.passes import binned
from services.radio_anomaly.presence import Presence
from tests.unit.radio_anomaly.made_up import SETTINGS, journeys, one_pass


def learned() -> Presence:
    presence = Presence()
    for journey in journeys(10):
        presence.learn(journey)
    return presence


def test_nothing_is_missing_on_a_normal_pass() -> None:
    assert learned().missing(journeys(1, 10)[0], SETTINGS) == []


def test_a_long_silence_is_certain_at_once() -> None:
    found = learned().missing(binned(one_pass(10, silent=range(10, 20)), SETTINGS), SETTINGS)
    assert [(one.start, one.length, one.confirmed) for one in found] == [(10, 10, True)]
    assert found[0].expected == 1.0
    assert found[0].passes == 5, "five of ten went up"


def test_a_short_silence_is_confirmed_by_the_next_pass_either_way() -> None:
    presence = learned()
    journey = binned(one_pass(10, silent=(12, 13)), SETTINGS)
    first = presence.missing(journey, SETTINGS)
    assert [one.confirmed for one in first] == [False]
    presence.remember(journey, first)
    back = binned(one_pass(11, silent=(13,)), SETTINGS)
    assert [one.confirmed for one in presence.missing(back, SETTINGS)] == [True]


def test_a_silence_between_two_others_is_told_apart() -> None:
    found = learned().missing(binned(one_pass(10, silent=(3, 4, 9)), SETTINGS), SETTINGS)
    assert [(one.start, one.length) for one in found] == [(3, 2), (9, 1)]


def test_a_new_radio_is_expected_only_from_its_first_day_on() -> None:
    presence = learned()
    for number in range(10, 20):
        rows = [*one_pass(number), *one_pass(number, radio="W2")]
        presence.learn(binned(sorted(rows, key=lambda one: one.t_ns), SETTINGS))
    share, passes = presence.share("W2", "ch1", "up", 5)
    assert (share, passes) == (1.0, 5.0)


def test_where_a_radio_came_and_went_silence_is_nothing_new() -> None:
    presence = Presence()
    for number in range(12):
        presence.learn(binned(one_pass(number, silent=(7,) if number % 4 < 2 else ()), SETTINGS))
    assert presence.missing(binned(one_pass(12, silent=(7,)), SETTINGS), SETTINGS) == []
