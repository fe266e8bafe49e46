from __future__ import annotations

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.position import TrainPosition
from schemas.radio import RadioMeasurement
from services.radio_probe import joining
from services.radio_probe.joining import Joiner
from services.radio_probe.journeys import REVERSAL_M, Journeys
from services.radio_probe.positions import NoPlace, Spot, Timeline

NS = 10**9


def position(t_s: float, axis_m: float | None, **fields: Any) -> TrainPosition:  # noqa: ANN401 - any field
    known: dict[str, Any] = {
        "status": "valid" if axis_m is not None else "lost",
        "reason": "" if axis_m is not None else "no odometry",
        "branch": "",
        "chainage_m": axis_m,
        "direction": "up",
        "speed_mps": 20.0,
        "bound_ahead_m": 4.0,
        "bound_behind_m": 6.0,
    }
    return TrainPosition(t_ns=round(t_s * NS), axis_m=axis_m, **(known | fields))


def timeline(*positions: TrainPosition) -> Timeline:
    out = Timeline("T1", 2.0, 300.0)
    for one in positions:
        out.take(one)
    return out


def at(line: Timeline, t_s: float) -> Spot | NoPlace | None:
    return line.at(round(t_s * NS))


def test_between_two_positions_the_place_is_between_them() -> None:
    spot = at(timeline(position(10, 1000.0), position(11, 1020.0)), 10.25)
    assert isinstance(spot, Spot)
    assert (spot.axis_m, spot.chainage_m, spot.bound_m, spot.speed_mps) == (1005.0, 1005.0, 6.0, 20.0)


def test_what_is_not_known_yet_and_what_never_will_be() -> None:
    line = timeline(position(10, 1000.0), position(11, 1020.0), position(15, 1100.0), position(15.5, None))
    assert at(line, 16.0) is None
    for t_s, words in ((9.0, "no position so early"), (13.0, "no position for 4.0 s"), (15.2, "no odometry")):
        there = at(line, t_s)
        assert isinstance(there, NoPlace)
        assert words in there.reason


def test_a_correction_widens_the_bound_by_the_leap() -> None:
    spot = at(timeline(position(10, 1000.0), position(10.1, 1052.0)), 10.05)
    assert isinstance(spot, Spot)
    # 52 m in a tenth of a second at 20 m/s: 50 m are the correction's.
    assert spot.bound_m == pytest.approx(6.0 + 50.0)
    far = at(timeline(position(10, 1000.0), position(10.1, 1400.0)), 10.05)
    assert isinstance(far, NoPlace)
    assert "only sure to" in far.reason


def test_over_a_broken_chain_kilometrage_goes_on_from_the_nearer_position() -> None:
    line = timeline(position(10, 1000.0, chainage_m=1000.0), position(11, 1020.0, chainage_m=1075.0))
    spots = [at(line, t_s) for t_s in (10.25, 10.75)]
    assert [one.chainage_m for one in spots if isinstance(one, Spot)] == [1005.0, 1070.0]


def test_where_kilometrage_falls_along_the_axis() -> None:
    spot = at(timeline(position(10, 1000.0, chainage_m=9000.0), position(11, 1020.0, chainage_m=8980.0)), 10.25)
    assert isinstance(spot, Spot)
    assert spot.chainage_m == 8995.0


def test_a_clock_that_is_set_back_begins_the_line_anew() -> None:
    line = timeline(position(1000, 1000.0), position(999.5, 990.0), position(10, 1000.0), position(11, 1020.0))
    spot = at(line, 10.5)
    assert isinstance(spot, Spot)
    assert spot.axis_m == 1010.0


@given(st.lists(st.tuples(st.floats(0.1, 1.9), st.floats(-30.0, 30.0)), min_size=2, max_size=30), st.floats(0, 1))
def test_a_place_lies_within_its_bound_of_both_neighbours(steps: list[tuple[float, float]], share: float) -> None:
    t_s, axis_m, line = 0.0, 5000.0, Timeline("T1", 2.0, 1e9)
    told = []
    for gap_s, speed_mps in steps:
        t_s, axis_m = t_s + gap_s, axis_m + gap_s * speed_mps
        told.append(position(t_s, axis_m, speed_mps=abs(speed_mps)))
        line.take(told[-1])
    wanted_ns = told[0].t_ns + round(share * (told[-1].t_ns - told[0].t_ns))
    spot = line.at(wanted_ns)
    assert isinstance(spot, Spot)
    before = max((one for one in told if one.t_ns <= wanted_ns), key=lambda one: one.t_ns)
    after = min((one for one in told if one.t_ns >= wanted_ns), key=lambda one: one.t_ns)
    low, high = sorted((before.axis_m or 0.0, after.axis_m or 0.0))
    assert low - 1e-6 <= spot.axis_m <= high + 1e-6
    assert spot.t_ns == wanted_ns


def follow(*positions: TrainPosition) -> list[str]:
    journeys, names = Journeys("T1"), list[str]()
    for one in positions:
        journeys.take(one)
        if not names or names[-1] != journeys.pass_id:
            names.append(journeys.pass_id)
    return names


def test_shunting_back_a_little_is_no_new_pass() -> None:
    there = [position(t_s, 1000.0 + 20.0 * t_s) for t_s in range(10)]
    back = [position(10 + t_s, 1180.0 - 10.0 * t_s, speed_mps=-10.0) for t_s in range(1, 9)]
    onwards = [position(20 + t_s, 1100.0 + 20.0 * t_s) for t_s in range(20)]
    assert follow(*there, *back, *onwards) == ["T1-19700101T000000Z-up"]


def test_going_back_further_is_one_and_going_on_again_another() -> None:
    far = round(REVERSAL_M / 10.0) + 2
    there = [position(t_s, 1000.0) for t_s in range(2)]
    back = [position(2 + t_s, 1000.0 - 10.0 * t_s, speed_mps=-10.0) for t_s in range(1, far + 5)]
    onwards = [position(60 + t_s, 900.0 + 10.0 * t_s, speed_mps=10.0) for t_s in range(far)]
    assert [name[-4:].strip("Z-") for name in follow(*there, *back, *onwards)] == ["up", "down", "up"]


def test_without_a_front_end_there_is_no_pass_and_after_a_long_pause_a_new_one() -> None:
    assert follow(position(0, 1000.0, direction=None), position(1, 1020.0, direction=None)) == [""]
    names = follow(position(0, 1000.0, direction=None), position(1, 1020.0), position(4000, 1020.0))
    assert names == ["", "T1-19700101T000001Z-up", "T1-19700101T010640Z-up"]


def test_too_much_waiting_goes_out_without_a_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(joining, "MOST_WAITING", 3)
    joiner = Joiner(60.0, 2.0, 300.0)
    for number in range(5):
        joiner.take("radio", RadioMeasurement(t_ns=number, radio="R", channel="1"), "T1", 0.0)
    out = joiner.ready(1.0)
    assert [one.message.t_ns for one in out] == [0, 1]
    assert {one.reason for one in out} == {"no position of T1 is heard"}


def test_of_too_many_trains_the_first_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(joining, "MOST_TRAINS", 2)
    joiner = Joiner(0.0, 2.0, 300.0)
    for number in range(3):
        joiner.position(f"T{number}", position(10, 1000.0 * number))
    for number in range(3):
        message = RadioMeasurement(t_ns=10 * NS, radio="R", channel="1", train=f"T{number}")
        joiner.take("radio", message, message.train, 0.0)
    assert [one.message.axis_m for one in joiner.ready(0.0)] == [None, 1000.0, 2000.0]


def test_the_message_keeps_all_that_the_device_said() -> None:
    joiner = Joiner(1.0, 2.0, 300.0)
    joiner.position("T1", position(10, 1000.0))
    said = RadioMeasurement(t_ns=10 * NS, radio="R", channel="1", decoded_power_dbm=-80.0, cell="c", temperature_c=31.0)
    joiner.take("radio", said, "T1", 0.0)
    (one,) = joiner.ready(0.0)
    told = msgspec.structs.asdict(one.message)
    kept = {name: value for name, value in msgspec.structs.asdict(said).items() if value not in (None, "")}
    assert kept.items() <= told.items()
