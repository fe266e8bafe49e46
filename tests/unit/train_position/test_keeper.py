"""The interval, and what moves it, one rule at a time."""

from __future__ import annotations

import itertools

import msgspec
import pytest

from schemas.position import ReferencePass, TrainChange
from services.train_position.settings import AntennaPlace, Config
from tests.unit.train_position.made_up import events_of, fix_of, run_with


def test_the_interval_grows_by_share_and_excess() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(100.0)
    run.slip(0.0, 7.0)
    run.go(0.1)
    position = run.position
    # 5 m at the claim, 2 % of 10.1 m/s · 100.1 s, and 7 m of slip; steps of floats.
    expected_m = 5.0 + 0.02 * 10.0 * 100.1 + 7.0
    assert position.bound_ahead_m == pytest.approx(expected_m, abs=0.01)
    assert position.bound_behind_m == pytest.approx(expected_m, abs=0.01)
    assert position.chainage_m == pytest.approx((position.axis_m or 0.0) + 1000.0, abs=0.01)
    assert position.direction == "up"


def test_the_provisional_part_counts_only_as_long_as_it_lasts() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    before_m = run.position.bound_ahead_m or 0.0
    run.provisional_m = 10.0
    run.go(0.1)
    assert run.position.bound_ahead_m == pytest.approx(before_m + 10.0, abs=0.1)
    run.provisional_m = 0.0
    run.go(0.1)
    assert run.position.bound_ahead_m == pytest.approx(before_m, abs=0.1)


def test_a_late_measurement_is_taken_at_its_own_time() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 50.0))
    run.go(10.0)
    late = run.landmark("C1", 0.0, 3.0)
    run.go(8.0)
    run.hear(late)
    run.go(0.1)
    # 3 m at the crossing and 2 % of the 81 m since.
    assert run.position.bound_ahead_m == pytest.approx(3.0 + 0.02 * 81.0, abs=0.2)
    run.require_true()
    (found,) = [one for one in run.heard if isinstance(one, ReferencePass)]
    assert found.within
    assert abs(found.error_m) < 1.0
    assert events_of(run, "reset")


def test_the_order_of_arrival_does_not_matter() -> None:
    intervals = set()
    for order in itertools.permutations(range(4)):
        run = run_with()
        run.go(10.0, 1.0)
        run.hear(run.front_end(0.0, 50.0))
        messages = []
        for number, bound_m in enumerate((20.0, 12.0, 9.0, 15.0)):
            run.go(3.0)
            messages.append(run.landmark(f"C{number}", number - 1.5, bound_m))
        run.go(1.0)
        for index in order:
            run.hear(messages[index])
        run.go(0.1)
        intervals.add(tuple(round(one, 6) for one in run.margin_m()))
    assert len(intervals) == 1


def test_measurements_ahead_of_the_odometry_wait_for_it() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.go(0.5, 0.0, silent=True)
    assert run.hear(run.front_end(0.0, 5.0)) == []
    run.heard += run.keeper.on_odometry(run.odometry())
    run.require_true()
    assert run.status() == "valid"


def test_a_fix_far_along_the_line_contradicts() -> None:
    run = run_with(Config(antennas={"front": AntennaPlace()}, clock_bound_s=0.0, holdover=0.0))
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(5.0)
    run.axis_m += 9_000.0
    run.hear(fix_of(run, 0.0), "front")
    run.axis_m -= 9_000.0
    run.go(0.1)
    assert run.status() == "degraded"
    run.require_true()


@pytest.mark.parametrize("first_m", [4.0, 30.0])
def test_a_match_with_a_looser_bound_does_not_widen_the_position(first_m: float) -> None:
    run, other = run_with(), run_with()
    for one in (run, other):
        one.go(10.0, 1.0)
        one.hear(one.front_end(0.0, first_m))
        one.go(1.0)
    run.hear(run.landmark("C1", 2.0, first_m + 20.0))
    for one in (run, other):
        one.go(0.1)
        one.require_true()
    (least_m, greatest_m), (low_m, high_m) = run.margin_m(), other.margin_m()
    assert low_m <= least_m
    assert greatest_m <= high_m
    assert greatest_m - least_m <= high_m - low_m


def test_the_occupied_stretch_is_the_train_and_its_bounds() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    position = run.position
    (stretch,) = position.occupied
    least_m, greatest_m = run.margin_m()
    assert (stretch.start_axis_m, stretch.end_axis_m) == pytest.approx((least_m - 60.0, greatest_m))
    assert position.min_safe_rear_end_m == pytest.approx(least_m - 60.0)
    assert position.max_safe_front_end_m == pytest.approx(greatest_m)
    run.hear(TrainChange(t_ns=run.t_ns, kind="cab", cab="B"))
    run.go(0.1)
    changed = run.position
    assert changed.direction == "down"
    assert changed.axis_m == pytest.approx((position.axis_m or 0.0) + 1.0 - 60.0, abs=0.1)
    (after,) = changed.occupied
    # The same train on the same rail, one metre further on; the odometry's share of that metre.
    assert (after.start_axis_m, after.end_axis_m) == pytest.approx(
        (stretch.start_axis_m + 1.0, stretch.end_axis_m + 1.0), abs=0.05
    )
    assert changed.speed_mps == pytest.approx(-10.0)


def test_the_clock_adds_its_metres() -> None:
    bounds = {}
    for clock_s in (0.0, 0.5):
        config = Config(clock_bound_s=clock_s, holdover=0.0, line_accuracy_m=0.0)
        run = run_with(config)
        run.go(20.0, 1.0)
        run.hear(run.front_end(0.0, 5.0))
        run.go(0.1)
        bounds[clock_s] = run.position.bound_ahead_m or 0.0
        # 20 m/s and its 0.3 m/s.
        assert run.position.clock_bound_m == pytest.approx(20.3 * clock_s)
    # At the claim and at the publication.
    assert bounds[0.5] - bounds[0.0] == pytest.approx(2 * 20.3 * 0.5, abs=0.01)


def test_holdover_grows_without_satellites() -> None:
    run = run_with(Config(clock_bound_s=0.0, holdover=1e-3))
    run.go(20.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    first_m = run.position.clock_bound_m
    run.go(10.0)
    assert run.position.clock_bound_m - first_m == pytest.approx(20.3 * 1e-3 * 10.0, rel=0.01)


def test_the_same_messages_give_the_same_bytes() -> None:
    def spoken() -> bytes:
        run = run_with()
        run.go(10.0, 1.0)
        run.hear(run.front_end(0.0, 5.0))
        run.go(5.0)
        run.hear(run.landmark("C1", 90.0))
        run.go(5.0)
        return b"".join(msgspec.msgpack.encode(one) for one in run.heard)

    assert spoken() == spoken()
