"""The line method from passes to events."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from schemas.radio import RadioAcceptance, RadioEvent
from services.radio_anomaly.monitor import Monitor
from services.radio_anomaly.passes import binned
from services.radio_anomaly.raising import Evidence, Raiser
from services.radio_anomaly.reading import Reading
from tests.unit.radio_anomaly.made_up import BEGIN_NS, DAY_NS, SECTIONS, SETTINGS, journeys, one_pass

LEARNED = 24


class Watch:
    """A monitor that has learned normal passes."""

    def __init__(self, learned: int = LEARNED) -> None:
        self.monitor = Monitor(SETTINGS)
        for journey in journeys(learned):
            self.monitor.learn(journey)
        self.raiser = Raiser(self.monitor, Evidence(false_alarm_rate=0.001, cells=1000))

    def take(self, readings: Sequence[Reading]) -> list[RadioEvent]:
        return self.raiser.take(binned(readings, SETTINGS))[0]


def confirmed(events: Sequence[RadioEvent]) -> list[RadioEvent]:
    return [one for one in events if one.confirmed and one.phase != "ended"]


def test_normal_passes_raise_nothing_that_is_confirmed() -> None:
    watch = Watch()
    assert [one for number in range(24, 60) for one in confirmed(watch.take(one_pass(number)))] == []


def test_an_empty_model_learns_and_raises_nothing() -> None:
    watch = Watch(learned=0)
    for number in range(4):
        events, judgement = watch.raiser.take(binned(one_pass(number, change_db=-30.0 * (number == 3)), SETTINGS))
        assert events == []
        assert judgement.learning == (("W1", "ch1"),)


def test_a_new_radio_on_a_known_line_is_learning_too() -> None:
    watch = Watch()
    events, judgement = watch.raiser.take(binned(one_pass(24, radio="W9"), SETTINGS))
    assert judgement.learning == (("W9", "ch1"),)
    assert [one.radio for one in events if one.kind != "missing"] == []
    assert {one.radio for one in events} == {"W1"}, "and the one that was expected is missing"


@pytest.mark.parametrize(
    ("change_db", "kind", "cause"), [(-10.0, "below", "obstruction"), (15.0, "above", "interference")]
)
def test_a_fault_is_found_where_it_is_and_called_what_it_is(change_db: float, kind: str, cause: str) -> None:
    watch = Watch()
    for number in (24, 25, 26):
        found = confirmed(watch.take(one_pass(number, change_db=change_db, stretch=(15, 25))))
    assert [(one.kind, one.cause, one.phase) for one in found] == [(kind, cause, "goes_on")]
    assert found[0].section_start_m == 1500.0
    assert found[0].section_end_m == 2500.0
    assert found[0].false_alarm_rate == 0.001
    assert found[0].lower_dbm is not None
    assert found[0].value_dbm is not None
    assert "learned from" in found[0].reason
    assert len({one.event_id for one in watch.take(one_pass(27, change_db=change_db, stretch=(15, 25)))}) == 1


def test_a_small_fault_needs_a_second_pass() -> None:
    watch = Watch()
    first = watch.take(one_pass(24, change_db=-4.5, stretch=(15, 18)))
    assert confirmed(first) == []
    second = watch.take(one_pass(25, change_db=-4.5, stretch=(15, 18)))
    assert [(one.kind, one.confirmed) for one in confirmed(second)] == [("below", True)]


def test_a_fault_never_becomes_the_normal_and_its_end_is_told() -> None:
    watch = Watch()
    for number in range(24, 84):
        found = confirmed(watch.take(one_pass(number, change_db=-10.0, stretch=(15, 25))))
        here = [one.kind for one in found if one.section_start_m < 2500.0 and one.section_end_m > 1500.0]
        assert number < 26 or here == ["below"], number
    ended = [one for number in range(84, 88) for one in watch.take(one_pass(number)) if one.phase == "ended"]
    assert [one.kind for one in ended] == ["below"]
    assert watch.monitor.events.open == []


def test_a_slow_fall_is_told_before_it_is_a_step_and_is_not_learned() -> None:
    watch = Watch()
    found: list[RadioEvent] = []
    number, fall_db = 24, 0.0
    while not found and fall_db < 3.0:
        fall_db = (number - 24) / 2.0
        events = watch.take(one_pass(number, change_db=-fall_db, ratio=None))
        found = [one for one in events if one.kind == "trend"]
        number += 1
    assert found, "told by three decibels"
    assert found[0].cause == "device"
    assert found[0].section_end_m - found[0].section_start_m == SECTIONS * 100.0
    assert "a day" in found[0].reason
    before = watch.monitor.streams[("W1", "ch1")].baseline("power", 120.0, None).line_mean
    for later in range(number, number + 10):
        watch.take(one_pass(later, change_db=-(later - 24) / 2.0))
    after = watch.monitor.streams[("W1", "ch1")].baseline("power", 120.0, None).line_mean
    assert after == pytest.approx(before, abs=0.05), "what fell was kept apart"


def acceptance(*, since_pass: int, revoked: bool = False) -> RadioAcceptance:
    return RadioAcceptance(
        t_ns=BEGIN_NS,
        acceptance_id="a1",
        radio="W1",
        section_start_m=1500.0,
        section_end_m=2500.0,
        since_ns=BEGIN_NS + since_pass // 2 * DAY_NS,
        by="Sato",
        why="new station roof",
        revoked=revoked,
    )


def test_an_accepted_normal_is_quiet_and_can_be_taken_back() -> None:
    watch = Watch()
    for number in range(24, 34):
        watch.take(one_pass(number, change_db=-10.0, stretch=(15, 25)))
    assert watch.monitor.accept(acceptance(since_pass=24))
    assert not watch.monitor.accept(acceptance(since_pass=24)), "said twice"
    for number in range(34, 40):
        assert confirmed(watch.take(one_pass(number, change_db=-10.0, stretch=(15, 25)))) == []
    assert confirmed(watch.take(one_pass(40))) != [], "the old normal is abnormal now"
    assert watch.monitor.accept(acceptance(since_pass=24, revoked=True))
    watch.take(one_pass(41))
    assert confirmed(watch.take(one_pass(42))) == []
    watch.take(one_pass(43, change_db=-10.0, stretch=(15, 25)))
    assert [one.kind for one in confirmed(watch.take(one_pass(44, change_db=-10.0, stretch=(15, 25))))] == ["below"]
    assert [word.revoked for word in watch.monitor.acceptances.log] == [False, True]


def test_a_silent_stretch_is_missing_not_normal() -> None:
    watch = Watch()
    found = confirmed(watch.take(one_pass(24, silent=range(10, 18))))
    assert [(one.kind, one.section_start_m, one.section_end_m) for one in found] == [("missing", 1000.0, 1800.0)]
    assert found[0].value_dbm is None
    assert "no sample" in found[0].reason
    assert found[0].cause == "unknown", "the radio was heard elsewhere, so it is not dead"


def test_a_silence_can_be_accepted_and_taken_back() -> None:
    watch = Watch()
    quiet = range(15, 25)
    for number in range(24, 28):
        assert [one.kind for one in confirmed(watch.take(one_pass(number, silent=quiet)))] == ["missing"]
    watch.monitor.accept(acceptance(since_pass=24))
    assert confirmed(watch.take(one_pass(28, silent=quiet))) == []
    watch.monitor.accept(acceptance(since_pass=24, revoked=True))
    assert [one.kind for one in confirmed(watch.take(one_pass(29, silent=quiet)))] == ["missing"]


def test_lost_reception_with_unchanged_power_is_interference() -> None:
    watch = Watch(learned=0)
    for number in range(LEARNED):
        watch.monitor.learn(binned(one_pass(number, ratio=0.995), SETTINGS))
    lost = [
        one if not 1500.0 <= (one.chainage_m or 0.0) < 2000.0 else type(one)(
            **{name: getattr(one, name) for name in one.__struct_fields__} | {"received_ratio": 0.5}
        )
        for one in one_pass(LEARNED, ratio=0.995)
    ]  # fmt: skip
    found = watch.take(lost)
    assert [(one.kind, one.cause) for one in found] == [("missing", "interference")]
    assert "reception 50%" in found[0].reason


def test_a_model_that_learns_as_it_goes_has_a_false_alarm_rate_of_its_own() -> None:
    monitor = Monitor(SETTINGS)
    raiser = Raiser(monitor, Evidence())
    for number in range(20):
        raiser.take(binned(one_pass(number), SETTINGS))
    assert monitor.alarms.rate is None, "16 passes of 40 sections are too few"
    for number in range(20, 40):
        raiser.take(binned(one_pass(number), SETTINGS))
    normal = monitor.alarms.rate
    assert normal is not None
    assert normal <= 0.01, "wanted of every model"
    for number in range(40, 70):
        before = raiser.false_alarm_rate
        events, _ = raiser.take(binned(one_pass(number, change_db=-10.0, stretch=(15, 25)), SETTINGS))
    assert {one.false_alarm_rate for one in events} == {before}, "with every event"
    # Of thirty passes with ten bad sections the first three count, among forty sections each.
    assert monitor.alarms.reported <= 40.0


def test_judging_changes_nothing() -> None:
    watch = Watch()
    journey = binned(one_pass(24, change_db=-10.0, stretch=(15, 25)), SETTINGS)
    first, second = watch.monitor.judge(journey), watch.monitor.judge(journey)
    assert first.findings == second.findings
    assert first.trends == second.trends
