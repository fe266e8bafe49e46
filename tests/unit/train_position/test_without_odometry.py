"""Where the position is while the odometry is lost, silent, set back or astray."""

from __future__ import annotations

from schemas.motion import SlipEpisode
from schemas.position import TrainChange
from tests.unit.train_position.made_up import Run, run_with


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


def _gone_astray() -> Run:
    """A run whose odometry takes the train to speed up in a slip, and says after ten seconds that all is not well."""
    run = run_with()
    run.go(20.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    slipping = {"slip": -1, "speed_bound_mps": 1.0, "provisional_m": 60.0}
    for k in range(200):
        # By 2.5 m/s², while it runs at 20 m/s; thereafter its word for the way is not true either.
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
    return run


def test_an_odometry_gone_astray_in_a_slip_is_not_believed_any_more() -> None:
    run = _gone_astray()
    assert run.status() == "degraded"
    assert run.position.stop_demanded


def test_satellites_narrow_the_place_while_the_odometry_is_not_believed() -> None:
    run = _gone_astray()
    assert (run.position.bound_ahead_m or 0.0) > 60.0
    run.hear(run.front_end(0.0, 16.0))
    run.go(0.1, silent=True)
    run.heard += run.keeper.on_odometry(run.odometry(slip=-1, speed_bound_mps=1.0, provisional_m=60.0))
    run.require_true()
    # What the slip has left open, 60 m, is no part of a place told since; in 0.1 s a train of 100 m/s goes 10 m, and
    # the line and the clock add less than three.
    bounds_m = (run.position.bound_ahead_m, run.position.bound_behind_m)
    assert sum(bound_m or 0.0 for bound_m in bounds_m) < 2 * (16.0 + 10.0 + 3.0)
    # Nor does the estimate hold to what the odometry said, 50 m away, whose doubt is far beyond the satellites'; they
    # speak the truth here, and their bound is 4.2 standard deviations.
    assert run.position.axis_m is not None
    assert abs(run.position.axis_m - run.front_m) < 16.0 / 4.2
