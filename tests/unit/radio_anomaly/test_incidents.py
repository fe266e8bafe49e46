"""Events that are one thing, and a radio that is dead."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from schemas.radio import Cause, RadioEvent
from services.radio_anomaly.event_book import OpenEvent
from services.radio_anomaly.incidents import NAMED, put_together, words_of
from services.radio_anomaly.monitor import Monitor
from services.radio_anomaly.passes import binned
from services.radio_anomaly.raising import Evidence, Raiser
from services.radio_anomaly.reading import Reading
from tests.unit.radio_anomaly.made_up import DAY_NS, SETTINGS, at, one_pass

D = 100.0


def event(
    radio: str, start: int, length: int, *, cause: Cause = "interference", day: int = 0, confirmed: bool = True
) -> OpenEvent:
    return OpenEvent(
        event_id=f"{radio}:{start}:{day}",
        radio=radio,
        channel="ch1",
        kind="above",
        start=start,
        length=length,
        first_seen_ns=day * DAY_NS,
        confirmed=confirmed,
        cause=cause,
    )


@pytest.mark.parametrize(
    ("other", "together"),
    [
        (event("R2", 25, 5), True),
        (event("R2", 29, 5), True),
        (event("R2", 31, 5), False),
        (event("R2", 25, 5, cause="device"), False),
        (event("R2", 25, 5, day=4), False),
        (event("R1", 25, 5, day=400), True),
        (event("R1", 15, 5, cause="obstruction"), True),
        (event("R1", 60, 5, cause="device"), False),
        (event("R1", 0, 0, cause="device"), True),
    ],
)
def test_what_belongs_together(other: OpenEvent, *, together: bool) -> None:
    first = event("R1", 10, 10)
    put_together([first], [first], D)
    other = OpenEvent(**{name: getattr(other, name) for name in other.__struct_fields__})
    put_together([other], [first, other], D)
    assert (first.incident_id == other.incident_id) is together
    assert first.incident_id == first.event_id, "the first keeps its name"


def test_an_event_between_two_incidents_makes_them_one() -> None:
    known = [event("R1", 10, 5), event("R2", 28, 5), event("R3", 15, 12)]
    for number in range(3):
        put_together(known[number : number + 1], known[: number + 1], D)
    assert {one.incident_id for one in known} == {"R1:10:0"}
    words = words_of("R1:10:0", known, D)
    assert words == "interference, 3 radios, 3 events: R1 ch1 1.0-1.5 km, R2 ch1 2.8-3.3 km, R3 ch1 1.5-2.7 km"


def test_an_unconfirmed_event_holds_nothing_together() -> None:
    known = [event("R1", 10, 5), event("R2", 28, 5), event("R3", 15, 12, confirmed=False)]
    for number in range(3):
        put_together(known[number : number + 1], known[: number + 1], D)
    assert known[2].incident_id == "R1:10:0"
    assert known[1].incident_id == "R2:28:0"


def test_the_words_stay_short() -> None:
    known = [event(f"R{number:02d}", 10, 5) for number in range(NAMED + 3)]
    put_together(known, known, D)
    assert words_of("R00:10:0", known, D).endswith("R07 ch1 1.0-1.5 km and 3 more")


def dead(readings: Sequence[Reading]) -> list[Reading]:
    return [at(one, power_dbm=-105.0, received_ratio=0.0) for one in readings]


class Line:
    """Two radios along a line, learned."""

    def __init__(self) -> None:
        self.monitor = Monitor(SETTINGS)
        for number in range(16):
            self.monitor.learn(binned(self.readings(number), SETTINGS))
        self.raiser = Raiser(self.monitor, Evidence())

    def readings(self, number: int, *, dead_radio: str = "") -> list[Reading]:
        found = []
        for radio in ("W1", "W2"):
            rows = one_pass(number, ratio=0.995, radio=radio)
            found += dead(rows) if radio == dead_radio else rows
        return sorted(found, key=lambda one: (one.t_ns, one.radio))


def test_a_dead_radio_is_a_device_and_one_incident() -> None:
    line = Line()
    for number in (16, 17):
        told, _ = line.raiser.take(binned(line.readings(number, dead_radio="W1"), SETTINGS))
        mine = [one for one in told if one.confirmed]
        assert {(one.radio, one.cause) for one in mine} == {("W1", "device")}
        assert len({one.incident_id for one in mine}) == 1
        assert mine[0].incident.startswith("device, ")


def test_a_radio_of_which_nothing_comes_any_more_is_a_device() -> None:
    line = Line()
    rows = [one for one in line.readings(16) if one.radio == "W2"]
    told, _ = line.raiser.take(binned(rows, SETTINGS))
    assert [(one.radio, one.kind, one.cause, one.confirmed) for one in told] == [("W1", "missing", "device", True)]


def test_a_dead_radio_is_not_called_an_obstruction_while_the_train_is_still_on_its_way() -> None:
    line = Line()
    rows = line.readings(16, dead_radio="W1")
    said: list[RadioEvent] = []
    for part in (30, 90, 150, len(rows)):
        journey = binned(rows[:part], SETTINGS)
        said += line.raiser.events_of(journey, line.monitor.judge(journey))
    causes = [one.cause for one in said if one.radio == "W1"]
    assert causes[0] == "unknown"
    assert "the rest will tell" in said[0].reason
    assert causes[-1] == "device"
    assert set(causes) == {"unknown", "device"}
