"""Pieces of the fused mode against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from services.odometry_fusion.fused_bound import ETCS_M, ETCS_SHARE, allowed, doubted, own_up, provisional, settle
from services.odometry_fusion.fused_branch import (
    MOST_HEAVE_MPS2,
    acceleration,
    begin_state,
    correct,
    predict,
    steady_force,
)
from services.odometry_fusion.fused_hypotheses import (
    begin_slip,
    end_slip,
)
from services.odometry_fusion.fused_layout import (
    ADHERING,
    GRAVITY_MPS2,
    NOW,
    SIZE,
    TH,
    B,
    D,
    M,
    V,
    W,
)
from services.odometry_fusion.fused_rim import watch_rim
from services.odometry_fusion.inertial_window import next_roll, next_variance
from services.odometry_fusion.motion_log import Floats, Vehicle
from services.odometry_fusion.standstill import STILL_TICKS, watch_standstill
from services.odometry_fusion.tick_layout import Records
from services.odometry_fusion.ticks import TickMaker
from services.odometry_fusion.wheel_measure import rim_variance
from tests.unit.odometry_fusion.fused_beginnings import fresh, tick_of

DT_S = 0.1
QUIET = np.zeros(5)


def run(x: Floats, p: Floats, steps: int, tick: Records, noise: Floats, mode: int = ADHERING) -> None:
    now = np.zeros(1, NOW)
    for _ in range(steps):
        predict(x, p, mode, DT_S, tick[0], now[0], noise)


def test_variance_of_speed_grows_as_an_anchor_in_the_past_says() -> None:
    x, p = np.zeros(SIZE), np.zeros((SIZE, SIZE))
    p[TH, TH], p[B, B], p[V, V] = 0.002**2, 1e-4**2, 0.05**2
    run(x, p, 40, tick_of(), QUIET)
    # (g T)² var(TH) + (g T²/2)² var(B) after T = 4 s; ATTITUDE_WALK adds (g q)² T³/3.
    seconds = 4.0
    expected = 0.05**2 + (GRAVITY_MPS2 * seconds * 0.002) ** 2 + (GRAVITY_MPS2 * seconds**2 / 2 * 1e-4) ** 2
    expected += (GRAVITY_MPS2 * 2e-4) ** 2 * seconds**3 / 3
    # Steps of 0.1 s sum rectangles where the integral has T²/2: 0.1/4 of each term at most.
    assert p[V, V] == pytest.approx(expected, rel=0.05)


def test_motion_on_a_gradient_is_freed_from_gravity() -> None:
    x, p = np.zeros(SIZE), np.zeros((SIZE, SIZE))
    x[TH] = 0.03
    ax, az = 0.5 + GRAVITY_MPS2 * np.sin(0.03), GRAVITY_MPS2 * np.cos(0.03)
    run(x, p, 100, tick_of(ax_mps2=ax, az_mps2=az), QUIET)
    level = np.cos(0.03)
    assert x[V] == pytest.approx(5.0 * level)
    assert x[D] == pytest.approx(25.0 * level)
    assert x[W] == pytest.approx(25.0 * level)


def test_a_dead_vertical_axis_is_no_free_fall() -> None:
    x = np.zeros(SIZE)
    x[TH] = 0.1
    assert acceleration(x, tick_of()[0]) == pytest.approx(-(GRAVITY_MPS2 - MOST_HEAVE_MPS2) * np.sin(0.1))


def test_a_steady_force_is_that_of_no_acceleration() -> None:
    x = np.zeros(SIZE)
    x[TH], x[M] = 0.05, 0.01
    tick = tick_of(ay_mps2=0.4, az_mps2=10.0)
    tick["ax_mps2"] = steady_force(x, tick[0])
    assert acceleration(x, tick[0]) == pytest.approx(0.0, abs=1e-15)


def test_pitch_rate_in_a_canted_curve_is_freed_from_the_yaw_rate() -> None:
    roll, yaw = 0.08, 0.05
    now = np.zeros(1, NOW)
    now["roll_rad"] = roll
    x, p = np.zeros(SIZE), np.zeros((SIZE, SIZE))
    # A level curve: the sensor turns with the yaw rate about an axis that stands at the roll angle.
    for _ in range(100):
        predict(x, p, ADHERING, DT_S, tick_of(gy_radps=yaw * roll, gz_radps=yaw)[0], now[0], QUIET)
    assert x[TH] == pytest.approx(0.0, abs=1e-12)


def test_a_crest_passed_at_even_speed_changes_no_speed_however_the_nose_is_mounted() -> None:
    """The train turns by 1.2 °/s over the crest; of v times that the pitched x axis shows some, and z the rest."""
    speed, mounted, rate = 20.0, -0.06, -0.02
    x, p = np.zeros(SIZE), np.zeros((SIZE, SIZE))
    x[V] = speed
    for k in range(20):
        x[TH] = mounted + rate * k * DT_S
        heave = speed * rate
        ax = heave * np.sin(mounted) + GRAVITY_MPS2 * np.sin(x[TH])
        az = heave * np.cos(mounted) + GRAVITY_MPS2 * np.cos(x[TH])
        predict(x, p, ADHERING, DT_S, tick_of(ax_mps2=ax, az_mps2=az, gy_radps=-rate)[0], np.zeros(1, NOW)[0], QUIET)
    # Level speed is that along the track times the gradient's cosine: 0.04 rad here, a thousandth.
    assert x[V] == pytest.approx(speed * np.cos(20 * DT_S * rate), rel=2e-4)


def test_roll_follows_gravity_in_a_curve_whatever_the_speed() -> None:
    roll = 0.0
    for k in range(1, 600):
        ay = 25.0 * 0.06 + GRAVITY_MPS2 * 0.05
        roll = next_roll(roll, ay, 0.0, 0.06, 0.0, 25.0, DT_S, k * DT_S)
    assert roll == pytest.approx(0.05)


def test_a_nose_held_down_shows_some_of_the_yaw_rate_as_roll_rate_and_that_is_no_roll() -> None:
    """A level curve with a sensor that is pitched, its y axis level: gravity shows no roll, and none is integrated."""
    roll, pitch, yaw = 0.0, -0.06, 0.12
    gx, gz = yaw * np.sin(pitch), yaw * np.cos(pitch)
    for k in range(1, 100):
        roll = next_roll(roll, 3.0 * gz, gx, gz, pitch, 3.0, DT_S, k * DT_S)
    assert roll == pytest.approx(0.0, abs=1e-12)


def test_white_noise_shows_its_variance_in_steps_from_mean_to_mean() -> None:
    noise = np.random.default_rng(3).normal(0.0, 0.2, 20_000)
    variance = 1.0
    for k in range(1, len(noise)):
        variance = next_variance(variance, noise[k] - noise[k - 1], 0.002)
    # A running mean over 500 of them has a standard deviation of 6 %; three of them.
    assert variance == pytest.approx(0.04, rel=0.2)


def test_teeth_alone_err_by_a_twelfth_of_a_pulse_squared_and_jitter_adds_to_it() -> None:
    rng = np.random.default_rng(5)
    for jitter_s, expected_m2 in ((0.0, 0.03**2 / 12), (0.01, 0.03**2 / 12 + (20.0 * 0.01) ** 2)):
        now = np.zeros(1, NOW)
        found = []
        for k in range(1500):
            way_m = 20.0 * (k * DT_S + rng.normal(0.0, jitter_s))
            found.append(rim_variance(np.floor(way_m / 0.03) * 0.03, 0.03, now[0], DT_S))
        # A running mean over half a minute of correlated differences: 12 % at one sigma.
        assert np.mean(found[-300:]) == pytest.approx(expected_m2, rel=0.4)


def test_standstill_gives_the_gyros_biases() -> None:
    now = np.zeros(1, NOW)
    tick = tick_of(gx_radps=1e-3, gz_radps=-2e-3)
    stands = [watch_standstill(tick[0], 0.03, now[0], DT_S) for _ in range(60)]
    assert stands.index(True) == STILL_TICKS - 1
    assert now["roll_bias_radps"][0] == pytest.approx(1e-3)
    assert now["yaw_bias_radps"][0] == pytest.approx(-2e-3)
    tick["way_m"] = 0.03
    assert not watch_standstill(tick[0], 0.03, now[0], DT_S)


def test_a_correction_is_that_of_a_kalman_filter_and_an_outlier_moves_less() -> None:
    x, p = np.zeros(SIZE), np.zeros((SIZE, SIZE))
    p[V, V], p[W, W], p[V, W], p[W, V] = 4.0, 1.0, 1.0, 1.0
    before = p.copy()
    correct(x, p, W, 1.0, 1.0)
    assert x[W] == pytest.approx(0.5)
    assert x[V] == pytest.approx(0.5)
    assert p[V, V] == pytest.approx(3.5)
    np.testing.assert_array_equal(p, p.T)
    far = np.zeros(SIZE)
    likely, unlikely = correct(np.zeros(SIZE), before.copy(), W, 0.1, 1.0), correct(far, before.copy(), W, 100.0, 1.0)
    # Huber: three sigma's worth of move, 3 · √2 · 1/2.
    assert far[W] == pytest.approx(3.0 * np.sqrt(2.0) / 2.0)
    assert likely > unlikely


def test_begins_without_standstill() -> None:
    x, p = np.ones(SIZE), np.ones((SIZE, SIZE))
    begin_state(x, p)
    assert (np.diag(p) > 0.0).all()
    assert not x.any()


def test_allowed_bound_is_that_of_etcs_forwards_and_counts_the_way_in_reverse() -> None:
    assert allowed(1000.0, 1000.0) == ETCS_M + ETCS_SHARE * 1000.0
    assert allowed(2000.0, 0.0) == ETCS_M + ETCS_SHARE * 2000.0


def test_what_a_loosely_known_end_leaves_in_doubt_is_vouched_for_and_then_owned() -> None:
    branches, now = fresh(10.0)
    begin_slip(branches, 0, 1, 0, 0.0)
    branches.x[1, D], branches.x[1, W] = 40.0, 10.0
    branches.about["loose_var"][1] = 0.5**2
    end_slip(branches, 1, 1, 100, float(now["creep_var"][0]))
    now["best"], now["branches"] = 1, 2
    # 30 m by which wheel and inertial sensor differ, whichever is right.
    assert doubted(branches, now[0]) == pytest.approx(30.0, abs=0.1)
    assert provisional(branches, now[0]) >= 30.0
    now["calm"], now["unsettled"] = 100, 1
    settle(branches, now[0])
    assert now["excess_m"][0] >= 30.0
    assert doubted(branches, now[0]) == 0.0


def test_a_change_of_the_way_beyond_what_was_vouched_for_is_owned() -> None:
    branches, now = fresh(0.0)
    now["scale"], now["vouched_m"], now["followed_m"] = 1.0, 5.0, 0.0
    branches.x[0, D] = 12.0
    own_up(branches, now[0], DT_S)
    assert now["excess_m"][0] == pytest.approx(7.0)
    own_up(branches, now[0], DT_S)
    assert now["excess_m"][0] == pytest.approx(7.0)


def test_a_rim_that_was_wild_is_not_believed_until_it_turns_calmly() -> None:
    _, now = fresh(20.0)
    now["rim_mps"], now["fast_rim_mps"], now["train_mps"] = 0.0, 20.0, 20.0
    for tick in range(200):
        now["tick"] = 100 + tick
        watch_rim(now[0], DT_S)
    # Locked for 20 s: the train may have lost as little as 0.2 m/s².
    assert now["broken"][0] == 1
    assert now["train_mps"][0] == pytest.approx(16.0)
    now["rim_mps"] = now["fast_rim_mps"] = 15.0
    watch_rim(now[0], DT_S)
    assert now["broken"][0] == 0
    assert now["train_mps"][0] == 15.0


def test_a_counter_that_waits_for_four_pulses_is_known_by_its_steps() -> None:
    t_s = 0.1 * np.arange(1.0, 41.0)
    vehicle = Vehicle(90.0, 0.81, 0.0, 35.0)
    for counts, expected in ((4 * np.arange(40), 4.0), (np.arange(40) // 2, 1.0), (np.arange(40) ** 2, 1.0)):
        ticks = TickMaker(vehicle).advance(4.0, np.empty(0), np.empty((0, 6)), t_s, counts.astype(np.int64))
        assert ticks["quantum_m"][-1] == pytest.approx(expected * vehicle.metres_per_pulse)


def test_a_fine_counter_that_creeps_stands_and_a_slow_wheel_does_not() -> None:
    """What a counter made of a gyro's rate errs by is no motion: 3 mm in 10 s here. 30 mm/s is."""
    for speed_mps, stood in ((0.0003, 100 - STILL_TICKS + 1), (0.03, 0)):
        now = np.zeros(1, NOW)
        ways_m = speed_mps * DT_S * np.arange(100)
        assert sum(watch_standstill(tick_of(way_m=one)[0], 0.0002, now[0], DT_S) for one in ways_m) == stood
