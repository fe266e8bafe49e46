"""What radio devices report becomes measurements with the train's place at that time."""

from __future__ import annotations

import pytest

from schemas.codec import encode
from schemas.line import Direction
from services.radio_probe.settings import Config
from services.runtime.manual_loop import manual_loop
from tests.replay.probe_stage import NS, SITE, START_NS, ProbeStage


def test_a_report_gets_the_place_of_its_own_time() -> None:
    with manual_loop() as loop:
        stage = ProbeStage(loop)
        stage.run(10.0, lambda t_s: 1000.0 + 20.0 * t_s)
        got = stage.measurements()
        assert len(got) >= 18
        for one in got[1:]:
            gone_s = (one.t_ns - START_NS) / NS
            # Interpolated between positions that are exact here; places are rounded to centimetres.
            assert one.axis_m == pytest.approx(1000.0 + 20.0 * gone_s, abs=0.006)
            assert one.chainage_m == pytest.approx(5200.0 + 20.0 * gone_s, abs=0.006)
            assert (one.direction, one.speed_mps, one.place_bound_m, one.branch) == ("up", 20.0, 4.0, "")
        assert {one.pass_id for one in got[1:]} == {"T1-20261026T073319Z-up"}
        assert [one.t_ns for one in got] == sorted(one.t_ns for one in got)
        assert stage.node.health.level(loop.time())[0] == "ok"
        stage.end()


def test_without_a_position_reports_go_out_without_a_place_and_health_says_so() -> None:
    with manual_loop() as loop:
        stage = ProbeStage(loop)
        stage.run(4.0, lambda t_s: 1000.0 + 20.0 * t_s if t_s < 2.0 else None)
        unplaced = [one for one in stage.measurements() if one.axis_m is None and one.t_ns > START_NS + NS]
        assert unplaced
        assert all(one.direction is None and one.pass_id == "" for one in unplaced)
        assert "the position is lost: no odometry" in stage.node.health.level(loop.time())[1][0]
        before = len(stage.measurements())
        stage.report(50.0)
        loop.advance(2.9)
        assert len(stage.measurements()) == before
        loop.advance(0.4)
        assert len(stage.measurements()) == before + 1
        stage.run(12.0, lambda t_s: 1200.0 + 20.0 * t_s)
        assert stage.node.health.level(loop.time())[0] == "ok"
        assert stage.node.health.counts["without_place"] >= len(unplaced)
        stage.end()


def test_a_reversal_and_a_cold_move_begin_new_passes() -> None:
    with manual_loop() as loop:
        stage = ProbeStage(loop)
        names: list[tuple[str, Direction | None]] = []
        for tick in range(400):
            t_s = tick / 10
            if t_s < 10:
                stage.stand(t_s, 1000.0 + 20.0 * t_s)
            elif t_s < 20:  # the other cab leads: its end is the front end now
                stage.stand(t_s, 1100.0 - 20.0 * (t_s - 10), facing="down")
            elif t_s < 30:  # it sets back
                stage.stand(t_s, 900.0 + 20.0 * (t_s - 20), speed_mps=-20.0, facing="down")
            else:  # and was towed away
                stage.stand(t_s, 9000.0 + 20.0 * (t_s - 30))
            if tick % 10 == 5:
                stage.report(t_s)
            loop.advance(0.1)
        for one in stage.measurements():
            if not names or names[-1] != (one.pass_id, one.direction):
                names.append((one.pass_id, one.direction))
        assert [direction for _, direction in names] == ["up", "down", "up", "up"]
        assert len({name for name, _ in names}) == 4
        stage.end()


def test_what_a_device_says_twice_or_cannot_mean_is_refused_and_counted() -> None:
    with manual_loop() as loop:
        stage = ProbeStage(loop)
        stage.report(0.0)
        stage.report(0.0)
        stage.report(0.1, channel_power_dbm=900.0)
        stage.report(0.2, decoded_power_dbm=float("nan"))
        stage.report(0.3, channel_power_dbm=None)
        stage.report(0.4, channel_power_dbm=None, received_ratio=0.0)
        loop.advance(4.0)
        assert [round((one.t_ns - START_NS) / NS, 1) for one in stage.measurements()] == [0.0, 0.4]
        counts = stage.node.health.counts
        assert {name: counts[name] for name in ("doubled", "absurd", "nothing_measured")} == {
            "doubled": 1,
            "absurd": 2,
            "nothing_measured": 1,
        }
        assert stage.node.health.level(loop.time())[0] == "degraded"
        stage.end()


@pytest.mark.parametrize("year_ns", [315_532_800 * NS, 2_082_758_400 * NS], ids=["1980", "2036"])
def test_a_device_with_a_reset_clock_is_placed_by_the_host_s_time(year_ns: int) -> None:
    with manual_loop() as loop:
        stage = ProbeStage(loop)
        stage.run(3.0, lambda t_s: 1000.0 + 20.0 * t_s)
        before = len(stage.measurements())
        stage.report((year_ns - START_NS) / NS)
        stage.run(6.0, lambda t_s: 1000.0 + 20.0 * t_s)
        there = [one for one in stage.measurements()[before:] if one.t_ns == START_NS + 3 * NS]
        assert [one.axis_m for one in there] == [1060.0]
        assert stage.node.health.counts["clock_off"] == 1
        stage.end()


def test_recordings_keep_their_own_time() -> None:
    with manual_loop() as loop:
        stage = ProbeStage(loop, Config(bus_stamps="device"))
        stage.report(-40_000_000.0, chainage_m=7000.0, direction="down", pass_id="night")
        got = stage.measurements()
        assert [(one.t_ns, one.chainage_m, one.pass_id) for one in got] == [
            (START_NS - 40_000_000 * NS, 7000.0, "night")
        ]
        stage.end()


def test_on_the_wayside_the_transmitting_train_s_place_is_taken() -> None:
    with manual_loop() as loop:
        stage = ProbeStage(loop, place=SITE)
        stage.run(5.0, lambda t_s: 3000.0 - 20.0 * t_s, train="T1", side="wayside")
        stage.report(4.9, train="T9")
        stage.report(4.95)
        loop.advance(4.0)
        got = stage.measurements()
        assert {one.train for one in got} == {"T1", "T9", ""}
        placed = [one for one in got if one.axis_m is not None]
        assert len(placed) >= 8
        for one in placed:
            assert one.axis_m == pytest.approx(3000.0 - 20.0 * (one.t_ns - START_NS) / NS, abs=0.006)
        assert all(one.axis_m is None for one in got if one.train != "T1")
        # A wayside radio that does not know who sends is no trouble; a train that nobody hears of is.
        assert "no position of T9 is heard" in str(stage.node.health.level(loop.time())[1])
        stage.end()


def test_the_same_reports_give_the_same_bytes() -> None:
    def once() -> list[bytes]:
        with manual_loop() as loop:
            stage = ProbeStage(loop)
            stage.run(5.0, lambda t_s: 1000.0 + 20.0 * t_s)
            stage.end()
            return [encode(one) for one in stage.heard]

    first = once()
    assert len(first) > 5
    assert once() == first
