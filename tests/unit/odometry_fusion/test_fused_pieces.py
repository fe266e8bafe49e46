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
    AGAINST_LOG,
    against_effort,
    begin_slip,
    end_crept,
    end_slip,
    prune,
    slip_share,
    take_over,
    turned_over,
)
from services.odometry_fusion.fused_layout import (
    ADHERING,
    BRANCH,
    BRANCHES,
    GRAVITY_MPS2,
    NOW,
    ROOM,
    SIZE,
    SLIPPING,
    TH,
    B,
    Branches,
    D,
    M,
    U,
    V,
    W,
)
from services.odometry_fusion.fused_noise import watch_walk
from services.odometry_fusion.fused_origin import begin_branches, begin_now
from services.odometry_fusion.fused_rim import watch_rim
from services.odometry_fusion.fused_step import RESTING_LOG, rest
from services.odometry_fusion.inertial_window import next_roll, next_variance
from services.odometry_fusion.motion_log import Floats, Vehicle
from services.odometry_fusion.standstill import STILL_TICKS, watch_standstill
from services.odometry_fusion.tick_layout import TICK, Records
from services.odometry_fusion.ticks import TickMaker
from services.odometry_fusion.wheel_measure import rim_variance

DT_S = 0.1
QUIET = np.zeros(5)


def tick_of(**values: float) -> Records:
    tick = np.zeros(1, TICK)
    for name, value in values.items():
        tick[name] = value
    return tick


def fresh(speed_mps: float = 10.0) -> tuple[Branches, Records]:
    now = np.zeros(1, NOW)
    begin_now(now[0])
    branches = Branches(np.zeros((ROOM, SIZE)), np.zeros((ROOM, SIZE, SIZE)), np.zeros(ROOM, BRANCH))
    begin_branches(branches, now[0], 0.0, 0.0, speed_mps)
    return branches, now


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


def test_a_slip_ends_the_sooner_the_nearer_its_speed_is_to_nought() -> None:
    branches, now = fresh()
    begin_slip(branches, 0, 1, 5, 0.0)
    prices = []
    for slip_mps in (0.0, 0.2, 1.0):
        branches.x[1, U], branches.p[1, U, U] = slip_mps, 0.1**2
        end_slip(branches, 1, 2, 40, float(now["creep_var"][0]))
        prices.append(float(branches.about["log_weight"][2] - branches.about["log_weight"][1]))
        assert branches.about["mode"][2] == ADHERING
    assert prices[0] > prices[1] > prices[2]


def test_brakes_do_not_make_wheels_spin_nor_traction_slide() -> None:
    # From half of 0.3 m/s² on the effort has a direction, and no slip against it goes for nothing.
    for slip_mps, effort_mps2, share in ((-0.4, 0.6, 1.0), (0.4, -0.225, 0.5), (-0.4, 0.15, 0.0), (0.4, 0.6, 0.0)):
        for sense in (1.0, -1.0):
            found = against_effort(sense * slip_mps, sense * effort_mps2)
            # Exact but for rounding.
            assert found == pytest.approx(share * AGAINST_LOG, abs=1e-9)
    assert against_effort(-0.4, 0.0) == 0.0


def test_taking_over_the_wheel_keeps_its_speed_and_gives_the_inertial_one_up() -> None:
    branches, now = fresh(10.0)
    begin_slip(branches, 0, 1, 0, 0.0)
    branches.p[1] = np.diag(np.full(SIZE, 1e-6))
    branches.x[1, U] = 1.5
    take_over(branches, 1, 2, 600, DT_S, float(now["creep_var"][0]))
    # 60 s of slip leave the inertial speed 5 m/s of doubt: the wheel's 11.5 m/s counts.
    assert branches.x[2, V] == pytest.approx(11.5, abs=0.05)
    assert branches.x[2, U] == pytest.approx(0.0, abs=0.05)


def test_a_slide_becomes_no_spin_unless_brakes_become_traction() -> None:
    for sense in (1.0, -1.0):
        found = [
            turned_over(sense * 0.4, sense * first, sense * now)
            for first, now in ((-0.8, -0.8), (-0.8, 0.0), (-0.8, 0.4))
        ]
        # Still braked, braked at first and coasting, pulling now: only the last can be.
        assert found == pytest.approx([AGAINST_LOG, AGAINST_LOG, 0.0], abs=1e-9)
    assert turned_over(0.4, 0.0, 0.0) == 0.0


def test_a_slip_that_comes_back_beyond_nought_loses_once() -> None:
    branches, now = fresh(20.0)
    begin_slip(branches, 0, 1, 0, -0.8)
    now["proven"], now["effort_mps2"] = 1, -0.8
    x, p, own = branches.x[1], branches.p[1], branches.about[1:2]
    p[U, U] = 0.05**2
    lost = []
    for slip_mps in (-0.1, -0.5, -0.5, 0.1, 0.19, 0.21, 0.3, -0.3):
        before, x[U] = float(own["log_weight"][0]), slip_mps
        watch_walk(x, p, own[0], 0.0, 1e-4, now[0])
        lost.append(float(own["log_weight"][0]) - before)
    assert lost == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0, AGAINST_LOG, 0.0, 0.0], abs=1e-9)


def test_what_micro_slip_before_the_start_point_did_to_speed_and_gradient_is_taken_back_at_the_end() -> None:
    """A start point within micro-slip of 0.1 m/s, and 1 mrad of gradient too much: what that made of 10 s of way."""
    seconds, off_mps, tilt = 10.0, 0.1, 1e-3
    branches, now = fresh(15.0)
    begin_slip(branches, 0, 1, 0, 0.0)
    branches.p[1] = np.diag(np.full(SIZE, 1e-8))
    wrong_mps = off_mps - GRAVITY_MPS2 * tilt * seconds
    x = branches.x[1]
    x[D], x[W], x[V], x[U], x[TH] = 150.0, 170.0, 15.0 + wrong_mps, -wrong_mps, tilt
    plain, crept, now["tick"] = float(now["creep_var"][0]), 2, 100
    end_slip(branches, 1, 3, 100, plain)
    end_crept(branches, 1, crept, now[0], DT_S)
    about = branches.about["log_weight"]
    # Both ends hold 2 cm/s against what the rim shows; only the crept one can say where it came from.
    assert abs(branches.x[crept, V] + branches.x[crept, U] - 15.0) < 1e-3
    assert branches.x[crept, V] == pytest.approx(15.0, abs=0.015)
    assert branches.x[crept, TH] == pytest.approx(0.0, abs=1.2e-3)
    assert branches.x[crept, W] == pytest.approx(170.0, abs=1e-3)
    assert about[crept] < about[1]
    x[V], x[U] = 15.6, -0.6
    end_slip(branches, 1, 3, 100, plain)
    end_crept(branches, 1, crept, now[0], DT_S)
    # 0.6 m/s left after 10 s are beyond what an inertial speed that began right may be off by.
    assert about[crept] > about[3] + 3.0


def test_a_wheel_that_stands_under_a_standing_train_no_longer_slips() -> None:
    """Nor does an account of a train that slides on over standing wheels lose, or one of wheels that adhere."""
    for account, speed_mps, lost in ((1, 0.1, RESTING_LOG), (1, 8.0, 0.0), (0, 0.1, 0.0)):
        branches, now = fresh(speed_mps)
        begin_slip(branches, 0, 1, 0, 0.0)
        own = branches.about[account : account + 1]
        before = float(own["log_weight"][0])
        branches.p[account, V, V] = 0.05**2
        rest(branches.x[account], branches.p[account], own[0], tick_of()[0], now[0])
        assert before - float(own["log_weight"][0]) == pytest.approx(lost)


def test_the_adhering_account_survives_any_number_of_better_ones() -> None:
    branches, now = fresh()
    for k in range(1, ROOM):
        begin_slip(branches, 0, k, k, 0.0)
        branches.about["log_weight"][k] = 10.0 + 0.1 * k
    now["branches"], now["tick"] = ROOM, 200
    prune(branches, now[0])
    assert int(now["branches"][0]) == BRANCHES
    assert ADHERING in branches.about["mode"][:BRANCHES]
    assert slip_share(branches, now[0]) > 0.99
    assert branches.about["mode"][int(now["best"][0])] == SLIPPING


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
