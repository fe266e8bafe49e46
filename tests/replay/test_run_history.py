"""The run history service on a bus in memory: legs told as logs are analysed, cut ones marked, the same bytes twice."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest
from msgspec.structs import replace

from schemas.codec import decode, encode
from schemas.position import TrainPosition
from schemas.runs import RunRecord
from schemas.topic import Place
from schemas.topics import RUN_RECORD, TRAIN_POSITION, topic_of
from services.line.line_file import load_line
from services.recorder.offline_replay import replay_through
from services.run_history.service import SERVICE, Config
from services.runtime.node import Sample
from services.simulator.train_run import TrainRun

TRAIN = Place("demo", "train", "T1")
T0_NS = 1_800_000_000_000_000_000
STATIONS = load_line(Path("demo")).line.stations[:3]
RUN = TrainRun(
    tuple(one.axis_m for one in STATIONS), cruise_mps=18.0, acceleration_mps2=0.6, braking_mps2=0.6, dwell_s=40.0
)


def positions(from_s: float, until_s: float) -> list[TrainPosition]:
    """Twice a second."""
    found = []
    for k in range(round(2 * from_s), round(2 * until_s)):
        motion = RUN.at(k / 2)
        found.append(
            TrainPosition(
                t_ns=T0_NS + k * 500_000_000,
                status="valid",
                reason="",
                branch="",
                axis_m=motion.axis_m,
                direction="up",
                speed_mps=abs(motion.speed_mps),
            )
        )
    return found


def told(sent: Iterable[TrainPosition], state_folder: str = "") -> tuple[list[RunRecord], list[bytes]]:
    samples = [Sample(TRAIN_POSITION.at(TRAIN), encode(one), b"", one.t_ns) for one in sent]
    heard = replay_through(samples, [SERVICE], {"run_history": Config(state_folder=state_folder)})
    mine = [one.payload for one in heard if (at := topic_of(one.key)) and at.topic is RUN_RECORD]
    return [decode(RunRecord, payload) for payload in mine], mine


def leg_s(first: int, last: int) -> float:
    """Running time of the trapezium."""
    distance = STATIONS[last].axis_m - STATIONS[first].axis_m
    return distance / 18.0 + 18.0 / 0.6


TWO_LEGS_S = 40.0 + leg_s(0, 1) + 40.0 + leg_s(1, 2) + 39.0


def test_legs_are_told_with_running_time_and_energy_and_the_same_bytes_twice() -> None:
    found, octets = told(positions(0.0, TWO_LEGS_S))
    assert [(one.from_station, one.to_station) for one in found] == [
        (STATIONS[0].id, STATIONS[1].id),
        (STATIONS[1].id, STATIONS[2].id),
    ]
    for number, one in enumerate(found):
        assert one.cut == ""
        assert one.direction == "up"
        assert one.excluded_because == ""
        # Below V_stop the core assumes 0.48 instead of 0.6 m/s²: 0.9 s; the smoother rounds corners by about 1 s.
        assert one.running_time_s == pytest.approx(leg_s(number, number + 1), abs=3.0)
        assert one.energy_kwh is not None
        # Kinetic energy of 150 t at 18 m/s is 6.75 kWh, nothing less could have done.
        assert 5.0 < one.energy_kwh < 60.0
        assert one.arrival_ns == one.t_ns
    assert told(positions(0.0, TWO_LEGS_S))[1] == octets


def test_a_restart_between_stations_gives_a_cut_leg_and_the_next_one_whole() -> None:
    found, _ = told(positions(100.0, TWO_LEGS_S))
    assert [(one.cut, one.from_station, one.to_station) for one in found] == [
        ("start", "", STATIONS[1].id),
        ("", STATIONS[1].id, STATIONS[2].id),
    ]
    assert found[0].running_time_s is None
    assert found[0].excluded_because
    assert found[1].running_time_s is not None


def test_positions_that_stop_under_way_end_the_leg_as_cut() -> None:
    before = positions(0.0, 100.0)
    later = [replace(one, t_ns=one.t_ns + 3_600_000_000_000) for one in positions(0.0, 30.0)]
    (record,) = told([*before, *later])[0]
    assert (record.cut, record.from_station, record.to_station) == ("end", STATIONS[0].id, "")
    assert record.t_ns == before[-2].t_ns


def test_positions_without_a_place_or_out_of_order_change_nothing() -> None:
    good = positions(0.0, TWO_LEGS_S)
    bad = [replace(one, axis_m=None, status="lost", t_ns=one.t_ns + 1) for one in good[::50]]
    repeated = [one for one in good for _ in range(2)]
    plain = told(good)[1]
    assert told(sorted([*good, *bad], key=lambda one: one.t_ns))[1] == plain
    assert told(repeated)[1] == plain


@pytest.mark.parametrize("cut_s", [10.0, 41.0, 100.0, 42.0 + leg_s(0, 1), 75.0 + leg_s(0, 1), 120.0 + leg_s(0, 1)])
def test_a_restart_goes_on_with_the_leg_under_way_and_tells_each_once(cut_s: float, tmp_path: Path) -> None:
    whole = told(positions(0.0, TWO_LEGS_S))[1]
    before = told(positions(0.0, cut_s), str(tmp_path))[1]
    after = told(positions(cut_s, TWO_LEGS_S), str(tmp_path))[1]
    assert before + after == whole


def test_a_record_that_was_not_put_down_as_told_is_told_again_with_the_same_bytes(tmp_path: Path) -> None:
    arrived_s = 40.0 + leg_s(0, 1) + 9.0  # below V_stop for 13 s: told at 15 s
    told(positions(0.0, arrived_s), str(tmp_path))
    (journal,) = (tmp_path / "run_history").iterdir()
    kept = journal.read_bytes()
    first = told(positions(arrived_s, arrived_s + 5.0), str(tmp_path))[1]
    journal.write_bytes(kept + b"[17,")  # killed after publishing, and in the middle of a line
    assert told(positions(arrived_s, arrived_s + 5.0), str(tmp_path))[1] == first
    assert len(first) == 1


def test_a_damaged_journal_is_refused_and_the_leg_begins_anew(tmp_path: Path) -> None:
    told(positions(0.0, 100.0), str(tmp_path))
    (journal,) = (tmp_path / "run_history").iterdir()
    journal.write_bytes(b"no journal\n")
    found, _ = told(positions(100.0, TWO_LEGS_S), str(tmp_path))
    assert [one.cut for one in found] == ["start", ""]


def test_a_clock_that_was_set_back_does_not_hold_up_what_comes() -> None:
    ahead = [replace(one, t_ns=one.t_ns + 3_600_000_000_000) for one in positions(0.0, 60.0)]
    found, _ = told([*ahead, *positions(0.0, TWO_LEGS_S)])
    assert [one.cut for one in found] == ["", ""]
