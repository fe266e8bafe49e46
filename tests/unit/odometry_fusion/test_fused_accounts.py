"""The fused mode's accounts of the wheels: how slips end, which of two is likelier, what is kept."""

from __future__ import annotations

import numpy as np
import pytest

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
    BRANCHES,
    GRAVITY_MPS2,
    ROOM,
    SIZE,
    SLIPPING,
    TH,
    D,
    U,
    V,
    W,
)
from services.odometry_fusion.fused_noise import watch_walk
from services.odometry_fusion.fused_step import RESTING_LOG, rest
from tests.unit.odometry_fusion.fused_beginnings import fresh, tick_of

DT_S = 0.1
QUIET = np.zeros(5)


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
