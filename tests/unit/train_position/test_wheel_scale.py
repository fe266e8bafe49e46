"""The wheel's scale: told by two references, widened as it wanders, forgotten when it changed, given away."""

from __future__ import annotations

import pytest

from schemas.motion import WheelScale as WheelScaleMessage
from schemas.position import TrainChange
from services.train_position.claims import Claim
from services.train_position.instants import Instant, Scale
from services.train_position.settings import Config
from services.train_position.wheel_scale import WheelScale
from tests.unit.train_position.made_up import run_with


def instant(distance_m: float, **changes: float) -> Instant:
    t_ns = round(distance_m * 1e8)
    start = Instant(t_ns, distance_m, distance_m, distance_m, distance_m, distance_m, distance_m, 0, 0, 0, 10.0, 0.0)
    return start._replace(**changes)  # type: ignore[arg-type]  # fields of the instant by name


def claim(axis_m: float, bound_m: float) -> Claim:
    return Claim("landmark", "C", 0, axis_m, bound_m, bound_m / 3.0)


def test_two_references_tell_the_scale() -> None:
    scale = WheelScale(0.0, 0.05)
    assert scale.now(0.02) == Scale(-0.02, 0.02)
    scale.reference(claim(1000.0, 2.0), instant(0.0), 1)
    assert scale.now(0.02) == Scale(-0.02, 0.02)
    scale.reference(claim(2010.0, 3.0), instant(1000.0), 1)
    # (1010 ± 5) / 1000 - 1
    assert scale.now(0.02) == pytest.approx((0.005, 0.015))
    scale.reference(claim(3021.0, 1.0), instant(2000.0), 1)
    # (2021 ± 3) / 2000 - 1 and (1011 ± 4) / 1000 - 1, and the one before
    assert scale.now(0.02) == pytest.approx((0.009, 0.012))
    assert scale.now(0.010) == pytest.approx((0.009, 0.010))


def test_the_wander_widens_what_was_learned() -> None:
    scale = WheelScale(0.002, 0.05)
    scale.reference(claim(0.0, 1.0), instant(0.0), 1)
    scale.reference(claim(1000.0, 1.0), instant(1000.0), 1)
    assert scale.now(0.02) == pytest.approx((-0.004, 0.004))


def test_turned_wheels_are_unknown_until_two_references() -> None:
    scale = WheelScale(0.001, 0.05)
    scale.turn()
    assert scale.now(0.02) == Scale(-0.05, 0.05)
    scale.reference(claim(0.0, 1.0), instant(0.0), -1)
    scale.reference(claim(-1040.0, 1.0), instant(1000.0), -1)
    # Beyond what the odometry vouches for, because the wheel is another one.
    assert scale.now(0.02) == pytest.approx((0.037, 0.043))


def test_a_scale_that_changed_is_forgotten() -> None:
    scale = WheelScale(0.001, 0.05)
    scale.reference(claim(0.0, 1.0), instant(0.0), 1)
    scale.reference(claim(1000.0, 1.0), instant(1000.0), 1)
    assert scale.reference(claim(2030.0, 1.0), instant(2000.0), 1)
    assert scale.now(0.02) == Scale(-0.02, 0.02)


def test_a_scale_that_the_odometry_applies_is_not_applied_again() -> None:
    scale = WheelScale(0.001, 0.05)
    scale.reference(claim(1000.0, 2.0), instant(0.0), 1)
    scale.reference(claim(2010.0, 2.0), instant(1000.0), 1)
    # (1010 ± 4) / 1000, and 1 per mille of wander, are three standard deviations.
    assert scale.told() == pytest.approx((1.010, 0.005 / 3.0))
    assert scale.apply(1.010) == pytest.approx(1.010)
    assert scale.learned == pytest.approx((-0.004 / 1.010, 0.004 / 1.010))
    told = scale.told()
    assert told is not None
    assert told[0] == pytest.approx(1.010)
    assert scale.apply(1.010) == 1.0


def test_a_scale_known_badly_is_not_told() -> None:
    scale = WheelScale(0.001, 0.05)
    assert scale.told() is None
    scale.reference(claim(0.0, 10.0), instant(0.0), 1)
    scale.reference(claim(1000.0, 10.0), instant(1000.0), 1)
    assert scale.told() is None


def test_the_odometry_is_told_the_scale_and_of_turned_wheels() -> None:
    run = run_with(Config())
    run.wheel_error, run.speed_mps = 0.01, 20.0
    run.go(1.0)
    for name in ("C1", "C2", "C3"):
        run.hear(run.landmark(name, 0.0, 2.0))
        run.go(60.0)
    run.hear(TrainChange(t_ns=run.t_ns, kind="wheel_turned"))
    *_, known, forgotten = (one for one in run.heard if isinstance(one, WheelScaleMessage))
    assert abs(known.scale - 1.01) <= 3.0 * known.sigma
    assert known.references == 3
    assert (forgotten.scale, forgotten.references) == (1.0, 0)


def test_slips_to_and_fro_and_short_stretches_tell_no_scale() -> None:
    scale = WheelScale(0.0, 0.05)
    scale.reference(claim(0.0, 1.0), instant(0.0), 1)
    scale.reference(claim(290.0, 1.0), instant(290.0), 1)
    scale.reference(claim(500.0, 1.0), instant(500.0, way_m=900.0), 1)
    assert scale.learned is None


def test_a_learned_scale_tightens_the_published_bound() -> None:
    config = Config(clock_bound_s=0.0, holdover=0.0, line_accuracy_m=0.0, scale_wander_share=0.001)
    run = run_with(config, wheel_error=0.012)
    run.makeup = run.makeup._replace(forward="cab")
    run.go(20.0, 1.0)
    run.hear(run.landmark("C1", 0.0, 3.0))
    for number in range(2, 6):
        run.go(100.0)
        run.hear(run.landmark(f"C{number}", 0.0, 3.0))
        run.go(0.1)
        run.require_true()
    start_m = run.position.bound_ahead_m or 0.0
    run.go(100.0)
    run.require_true()
    # (3 + 3) / 8000 m over the longest stretch, and the wander: 0.2 % instead of 2 % of 2 km.
    assert (run.position.bound_ahead_m or 0.0) - start_m < 0.0025 * 2000.0
    estimate = run.keeper.held.estimate
    assert estimate is not None
    assert estimate.scale == pytest.approx(0.012, abs=0.001)
