"""The keeper, one rule at a time."""

from __future__ import annotations

import itertools

import msgspec
import pytest

from schemas.gnss import Fix
from schemas.motion import SlipEpisode
from schemas.position import BalisePassage, BranchEvidence, PositionEvent, ReferencePass, TrainChange
from services.train_position.settings import AntennaPlace, Config
from tests.unit.train_position.made_up import DEGREES, LENGTH_M, START_NS, Run, run_with


def events(run: Run, kind: str) -> list[str]:
    return [one.text for one in run.heard if isinstance(one, PositionEvent) and one.kind == kind]


def test_nothing_known_is_lost_with_a_reason_and_no_place() -> None:
    run = run_with()
    run.go(1.0, 1.0)
    position = run.position
    assert position.status == "lost"
    assert position.reason
    assert position.axis_m is None
    assert position.occupied == ()
    assert position.speed_mps is not None


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
    assert events(run, "reset")


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


def test_direction_by_the_way_from_place_to_place() -> None:
    run = run_with(sense=-1, axis_m=9_000.0)
    run.go(10.0, 1.0)
    for _ in range(20):
        run.hear(run.front_end(0.0, 5.0, facing=None))
        run.go(1.0)
    assert run.position.direction == "down"
    assert run.position.speed_mps == pytest.approx(10.0)
    assert len(events(run, "direction")) == 1
    run.require_true()
    # What was claimed before the direction was known is taken anew: no more than a claim and a second's share.
    assert (run.position.bound_ahead_m or 0.0) < 6.0


def test_direction_by_the_satellites_speed() -> None:
    run = run_with(
        Config(antennas={"front": AntennaPlace(behind_m=2.0)}, clock_bound_s=0.0, holdover=0.0, forward="vehicle")
    )
    run.go(10.0, 1.0)
    run.hear(fix_of(run, 2.0), "front")
    run.hear(fix_of(run, 2.0, t_ns=run.t_ns - 1), "front")
    run.go(0.1)
    run.hear(fix_of(run, 2.0), "front")
    run.go(0.1)
    assert run.position.direction == "up"
    run.require_true()


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


def fix_of(run: Run, behind_m: float, north_deg: float = 0.0, **changes: object) -> Fix:
    fields: dict[str, object] = {
        "t_ns": run.t_ns,
        "gps_week": 0,
        "tow_s": 0.0,
        "method": "robust",
        "status": "fix",
        "lat_deg": north_deg,
        "lon_deg": (run.axis_m - run.sense * behind_m) / LENGTH_M * DEGREES,
        "h_m": 0.0,
        "ve_mps": run.sense * run.speed_mps,
        "vn_mps": 0.0,
        "satellites_used": 8,
        "satellites_flagged": 0,
        "bound_m": 5.0,
    }
    return Fix(**(fields | changes))  # type: ignore[arg-type]  # fields of the message by name


def test_a_first_place_takes_two_landmarks() -> None:
    run = run_with()
    run.go(20.0, 0.5)
    run.hear(run.landmark("C1"))
    run.go(30.0)
    assert run.status() == "lost"
    assert "another landmark" in run.position.reason
    run.hear(run.landmark("C2"))
    run.go(0.1)
    assert run.status() == "valid"
    run.require_true()


def test_two_landmarks_at_a_wrong_distance_make_no_place() -> None:
    run = run_with()
    run.go(20.0, 0.5)
    run.hear(run.landmark("C1", 300.0))
    run.go(30.0)
    run.hear(run.landmark("C2"))
    run.go(0.1)
    assert run.status() == "lost"


def test_a_balise_makes_a_first_place() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(BalisePassage(t_ns=run.t_ns, balise="B2"))
    run.go(0.1)
    assert run.status() == "degraded"
    assert "direction" in run.position.reason


@pytest.mark.parametrize(
    ("message", "kind"),
    [
        (BalisePassage(t_ns=START_NS + 10**10, balise="unknown"), "balise"),
        (BalisePassage(t_ns=START_NS + 10**10, balise="B2", sensor_offset_m=1e30), "balise"),
        (BalisePassage(t_ns=-5, balise="B2"), "old"),
        (BalisePassage(t_ns=START_NS + 10**16, balise="B2"), "time"),
        (TrainChange(t_ns=START_NS + 10**10, kind="coupled", length_m=1e12), "change"),
        (TrainChange(t_ns=START_NS + 10**10, kind="coupled", length_m=1.0), "change"),
        (TrainChange(t_ns=START_NS + 10**10, kind="uncoupled", length_m=100.0), "change"),
        (TrainChange(t_ns=START_NS + 10**10, kind="cab"), "change"),
        (TrainChange(t_ns=START_NS + 10**10, kind="route", branch="nowhere"), "change"),
        (
            BranchEvidence(t_ns=START_NS + 10**10, junction_axis_m=1.0, decided="nowhere", chances=(), reason=""),
            "branch",
        ),
        (
            BranchEvidence(t_ns=START_NS + 10**10, junction_axis_m=20_000.0, decided="north", chances=(), reason=""),
            "branch",
        ),
    ],
)
def test_absurd_messages_are_counted_and_change_nothing(message: BalisePassage | TrainChange, kind: str) -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    before = run.margin_m()
    run.hear(message)
    after = run.keeper.on_odometry(run.odometry(t_ns=run.t_ns + 1))
    assert run.keeper.refused == {kind: 1}
    run.heard += after
    assert run.margin_m() == pytest.approx(before, abs=0.01)
    assert len(run.keeper.take_refusals()) == 1
    assert run.keeper.take_refusals() == []


@pytest.mark.parametrize(
    "changes",
    [
        {"distance_m": 1e30},
        {"speed_mps": -1e9},
        {"excess_m": 1e12},
        {"share_bound": 55.0},
        {"t_ns": -1},
        {"way_m": 0.0},
        {"t_ns": START_NS},
    ],
)
def test_absurd_odometry_is_refused(changes: dict[str, object]) -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    run.t_ns += 100_000_000
    assert run.keeper.on_odometry(run.odometry(**changes)) == []
    assert run.keeper.refused == {"odometry": 1}
    run.axis_m += 1.0
    run.distance_m += 1.0
    run.way_m += 1.0
    run.heard += run.keeper.on_odometry(run.odometry())
    run.require_true()
    assert run.status() == "valid"


def test_a_clock_that_was_set_back_costs_two_seconds() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(1.0)
    run.t_ns -= 3_600 * 10**9
    run.go(3.0)
    assert run.position.t_ns == run.t_ns
    run.require_true()
    assert run.status() == "valid"


def test_another_line_version_refuses_landmarks() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    for number in range(3):
        run.go(1.0)
        run.hear(run.landmark(f"C{number}", 0.0, 1.0, line_version="2"))
    assert run.keeper.refused == {"line_version": 3}
    assert "version 2" in events(run, "line_version")[0]
    assert not [one for one in run.heard if isinstance(one, ReferencePass)]


def test_a_landmark_met_in_the_other_direction_is_refused() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.hear(run.landmark("C1", direction="down"))
    assert run.keeper.refused == {"landmark": 1}


def test_a_refused_match_is_shown_and_not_taken() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.hear(run.landmark("C1", accepted=False, reason="length", bound_m=0.0))
    run.go(0.1)
    (state,) = [one for one in run.position.sources if one.source == "landmark"]
    assert not state.taken
    assert "length" in state.reason
    assert run.keeper.refused == {}


def test_cold_movement_is_lost_until_a_reference() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    run.hear(TrainChange(t_ns=run.t_ns, kind="moved_cold", note="hauled"))
    run.go(0.1)
    assert run.status() == "lost"
    assert "moved" in run.position.reason
    assert run.position.axis_m is None
    run.axis_m += 4_000.0
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    run.require_true()
    assert run.status() == "valid"


def test_odometry_that_is_lost_leaves_physics() -> None:
    run = run_with()
    run.go(20.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    for _ in range(50):
        run.go(0.1, -0.8, silent=True)
        run.heard += run.keeper.on_odometry(run.odometry(status="lost", distance_m=0.0, speed_mps=0.0))
        run.require_true()
    assert run.status() == "degraded"
    assert run.position.speed_mps is None
    run.go(0.1)
    assert run.status() == "valid"
    run.require_true()
    # The odometry counted on: 5 m and 2 % of the way, not what physics allows.
    assert (run.position.bound_ahead_m or 0.0) < 9.0


def test_without_odometry_for_too_long_it_is_lost() -> None:
    run = run_with()
    run.go(20.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    for _ in range(400):
        run.go(0.1, 0.0, silent=True)
        said = run.keeper.on_time(run.t_ns)
        run.heard += said
        if said:
            run.require_true()
    assert run.status() == "lost"


def test_satellites_carry_the_position_alone() -> None:
    run = run_with()
    run.speed_mps = 20.0
    for _ in range(100):
        run.go(0.2, 0.0, silent=True)
        run.hear(run.front_end(2.0, 5.0))
        run.heard += run.keeper.on_time(run.t_ns)
    run.require_true()
    assert run.status() == "degraded"


def test_a_stop_is_demanded_until_the_train_stands() -> None:
    run = run_with()
    run.go(10.0, 1.0)
    run.hear(
        SlipEpisode(
            t_ns=run.t_ns,
            origin="o1",
            episode=1,
            phase="not_found",
            slip=-1,
            start_t_ns=run.t_ns,
            correction_s=30.0,
            bound_m=40.0,
            stop_demanded=True,
            reason="no re-adhesion",
        )
    )
    run.go(0.1)
    assert run.position.stop_demanded
    run.go(10.1, -1.0)
    run.speed_mps = 0.0
    run.go(0.1)
    assert not run.position.stop_demanded


def test_an_odometry_gone_astray_in_a_slip_is_not_believed_any_more() -> None:
    run = run_with()
    run.go(20.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    slipping = {"slip": -1, "speed_bound_mps": 1.0, "provisional_m": 60.0}
    for k in range(200):
        # It takes the train to speed up by 2.5 m/s² while it runs at 20 m/s, and notices after ten seconds that all is
        # not well; thereafter its word for the way is not true either.
        run.go(0.1, silent=True)
        if k == 100:
            run.hear(
                SlipEpisode(
                    t_ns=run.t_ns,
                    origin="o1",
                    episode=1,
                    phase="not_found",
                    slip=-1,
                    start_t_ns=run.t_ns,
                    correction_s=10.0,
                    bound_m=60.0,
                    stop_demanded=True,
                    reason="no re-adhesion",
                )
            )
        lie_m = 0.5 * min(k, 100) / 100.0 * 100.0 + (10.0 * (k - 100) if k > 100 else 0.0)
        mistaken = {"distance_m": run.distance_m + lie_m, "way_m": run.way_m + lie_m, "speed_mps": 20.0 + 0.25 * k}
        run.heard += run.keeper.on_odometry(run.odometry(**(slipping | mistaken)))
        run.require_true()
    assert run.status() == "degraded"
    assert run.position.stop_demanded


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
