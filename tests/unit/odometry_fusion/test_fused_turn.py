"""Whether a turned inertial sensor could make a slip seem one, in slips whose motion is known."""

from __future__ import annotations

import numpy as np
import pytest

from services.odometry_fusion.fused_layout import (
    BRANCH,
    GRAVITY_MPS2,
    NOW,
    ROOM,
    SIZE,
    SLIPPING,
    TH,
    Branches,
    U,
    V,
)
from services.odometry_fusion.fused_turn import FORWARDS, PROOF, SETTLED_S, UNKNOWN, least_miss, watch_turns
from services.odometry_fusion.tick_layout import TICK

DT_S = 0.1
SPEED_MPS = 15.0
BRAKES_MPS2 = -0.5
PITCH_RAD = 0.02
BLIND = False


def found(
    rim_mps2: float,
    inertial_mps2: float,
    turned_rad: float = 0.0,
    yaw_radps: float = 0.0,
    shown: float = 2.0 * PROOF,
    seconds: float = 4.0,
) -> tuple[int, float]:
    """What is found of a slip on a gradient in a train that brakes, and the least miss [m/s].

    The sensor is turned by so much, and the account believes in an acceleration of `inertial_mps2`.
    """
    now, tick = np.zeros(1, NOW), np.zeros(1, TICK)
    branches = Branches(np.zeros((ROOM, SIZE)), np.zeros((ROOM, SIZE, SIZE)), np.zeros(ROOM, BRANCH))
    now["branches"], now["not_turned"], now["roll_settled_s"] = 1, shown, 2.0 * SETTLED_S
    own, x = branches.about[0], branches.x[0]
    own["mode"], own["slip_since"] = SLIPPING, 1
    x[TH], tick["gz_radps"] = PITCH_RAD, yaw_radps
    c, s = np.cos(turned_rad), np.sin(turned_rad)
    for k in range(round(seconds / DT_S)):
        t_s = k * DT_S
        ahead = BRAKES_MPS2 + GRAVITY_MPS2 * PITCH_RAD
        aside = (SPEED_MPS + BRAKES_MPS2 * t_s) * yaw_radps
        tick["ax_mps2"], tick["ay_mps2"] = c * ahead - s * aside, s * ahead + c * aside
        now["tick"] = k + 2
        x[V] = SPEED_MPS + inertial_mps2 * t_s
        x[U] = SPEED_MPS + rim_mps2 * t_s - x[V]
        watch_turns(tick[0], now[0], branches, BLIND, DT_S)
    return int(own["facing"]), float(least_miss(own, x[V] + x[U]))


def test_a_sliding_wheel_beside_a_quiet_y_axis_shows_that_the_sensor_looks_forward() -> None:
    facing, missed_mps = found(rim_mps2=-1.2, inertial_mps2=BRAKES_MPS2)
    assert facing == FORWARDS
    # No angle explains the 0.7 m/s² by which the wheel is ahead in braking, for what is left of 4 s once it has shown.
    assert missed_mps == pytest.approx(0.7 * 3.6, abs=0.3)


@pytest.mark.parametrize("yaw_radps", [0.0, 0.03])
@pytest.mark.parametrize("turned_rad", [np.pi / 2.0, -np.pi / 2.0, np.pi, 2.0])
def test_a_turned_sensor_is_never_found_to_look_forward(turned_rad: float, yaw_radps: float) -> None:
    for seconds in (1.0, 2.0, 4.0, 8.0):
        believed_mps2 = BRAKES_MPS2 * np.cos(turned_rad) - SPEED_MPS * yaw_radps * np.sin(turned_rad)
        assert found(BRAKES_MPS2, believed_mps2, turned_rad, yaw_radps, seconds=seconds)[0] != FORWARDS


def test_without_proof_that_x_ever_showed_the_motion_nothing_is_found() -> None:
    assert found(rim_mps2=-1.2, inertial_mps2=BRAKES_MPS2, shown=0.5 * PROOF)[0] == UNKNOWN


def test_a_wheel_that_is_off_against_the_effort_proves_nothing() -> None:
    assert found(rim_mps2=0.7, inertial_mps2=BRAKES_MPS2)[0] != FORWARDS
