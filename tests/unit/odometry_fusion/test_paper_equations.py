"""Equations of Iwata et al., one by one, against values worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from services.odometry_fusion.motion_log import Vehicle
from services.odometry_fusion.paper_attitude import forward_acceleration, initial_pitch, initial_roll, pitch_rate
from services.odometry_fusion.paper_detection import accelerations_differ
from services.odometry_fusion.paper_error import closed_error, distance_error
from services.odometry_fusion.paper_layout import CONSTANT, NONE, SMOOTHED, YAW, YAW_AND_ROLL, rules_of
from services.odometry_fusion.paper_readhesion import adheres_again
from services.odometry_fusion.paper_settings import PaperSettings
from services.odometry_fusion.paper_start_point import least_jerk, start_point

VEHICLE = Vehicle(90.0, 0.816, 0.3, 35.0)
G = 9.80665


def test_1_compares_accelerations() -> None:
    assert accelerations_differ(0.5, 0.1, 0.39)
    assert not accelerations_differ(0.5, 0.1, 0.41)
    assert accelerations_differ(-0.5, -0.1, 0.39)


def test_2_and_3_are_inverse_to_each_other() -> None:
    pitch = initial_pitch(0.9, 0.6)
    assert pitch == pytest.approx(math.asin(0.3 / G), abs=1e-15)
    assert forward_acceleration(0.9, pitch) == pytest.approx(0.6, abs=1e-14)
    assert initial_pitch(100.0, 0.0) == pytest.approx(math.pi / 2)  # held to what arcsin takes


def test_5_and_12_take_out_what_roll_turns_into_pitch() -> None:
    roll, yaw, roll_rate = 0.08, 0.05, 0.02
    # A track that keeps its gradient: the sensor's pitch rate is -ωz sin ψ.
    measured = -yaw * math.sin(roll)
    assert pitch_rate(YAW, roll_rate, measured, yaw, roll) == pytest.approx(0.0, abs=1e-15)
    assert pitch_rate(NONE, roll_rate, measured, yaw, roll) == measured
    assert pitch_rate(CONSTANT, roll_rate, measured, yaw, roll) == 0.0
    second = roll_rate * math.sin(roll)
    assert pitch_rate(YAW_AND_ROLL, roll_rate, measured, yaw, roll) == pytest.approx(-second)  # left: k = +1
    assert pitch_rate(YAW_AND_ROLL, roll_rate, -measured, -yaw, roll) == pytest.approx(second)  # right: k = -1


def test_11_gives_the_roll_of_cant_in_a_curve() -> None:
    roll, speed, yaw = -0.07, 20.0, 0.06
    # To the left, the left side down: gravity and the centripetal force on the left-hand axis.
    lateral = G * math.sin(roll) + speed * yaw
    assert initial_roll(lateral, G * math.cos(roll), speed, yaw) == pytest.approx(roll, abs=1e-12)


def test_13_gives_the_papers_22_8_m() -> None:
    paper = PaperSettings(threshold_error_kmhps=1.23, gyro_error_dps=0.1, bias_hold_s=1_800.0)
    # After half an hour without a standstill the gyro's error is the paper's; it takes 9.8 m/s² per radian.
    assert distance_error(rules_of(paper, VEHICLE), 10.0, 1_800.0) == pytest.approx(22.8, abs=0.05)


def test_13_grows_with_time_and_with_the_age_of_the_biases() -> None:
    rules = rules_of(PaperSettings(), VEHICLE)
    errors = [distance_error(rules, t_s, 60.0) for t_s in (2.0, 5.0, 10.0, 30.0)]
    assert errors == sorted(errors)
    assert distance_error(rules, 10.0, 0.0) < distance_error(rules, 10.0, 1_800.0) < distance_error(rules, 10.0, 7e3)


def test_re_adhesion_bounds_the_error_more_closely_but_never_less() -> None:
    rules = rules_of(PaperSettings(), VEHICLE)
    assert closed_error(rules, 12.0, 60.0, 0.1) < distance_error(rules, 12.0, 60.0)
    assert closed_error(rules, 12.0, 60.0, 50.0) == distance_error(rules, 12.0, 60.0)


def test_the_threshold_has_headroom_over_the_steepest_gradient() -> None:
    own = rules_of(PaperSettings(), VEHICLE)["detection_mps2"][0]
    assert own * 3.6 == pytest.approx(0.035 * G * 3.6 + 0.37)
    assert rules_of(PaperSettings(detection_kmhps=1.23), VEHICLE)["detection_mps2"][0] == pytest.approx(1.23 / 3.6)


def calm(count: int) -> np.ndarray:
    smoothed = np.zeros(count, SMOOTHED)
    smoothed["ready"] = smoothed["wheel_ready"] = 1
    return smoothed


def test_the_start_point_is_the_last_of_three_calm_periods() -> None:
    rules = rules_of(PaperSettings(), VEHICLE)
    smoothed = calm(100)
    smoothed["jerk_wheel"][60:] = 1.0
    assert start_point(smoothed, 80, 0, rules) == 59
    smoothed["jerk_imu"][58] = 0.1  # breaks the run: neither 57…59 nor 58…60
    assert start_point(smoothed, 80, 0, rules) == 57
    smoothed["wheel_ready"][:58] = 0
    assert start_point(smoothed, 80, 0, rules) == -1


def test_without_a_start_point_the_least_difference_of_jerks_serves() -> None:
    smoothed = calm(50)
    smoothed["jerk_imu"] = 1.0
    smoothed["jerk_imu"][20] = 0.5
    rules = rules_of(PaperSettings(), VEHICLE)
    assert least_jerk(smoothed, 49, 0, rules) == 20
    smoothed["wheel_mps2"][20] = 1.0  # equation (3) would give a gradient of 10 %
    assert least_jerk(smoothed, 49, 0, rules) == 49
    smoothed["ready"] = 0
    assert least_jerk(smoothed, 49, 0, rules) == -1


def test_re_adhesion_needs_both_accelerations_and_speeds() -> None:
    rules = rules_of(PaperSettings(beta_kmhps=0.36), VEHICLE)  # 0.1 m/s²
    smoothed = calm(1)
    smoothed["speed_mps"] = 10.0
    assert adheres_again(smoothed, 0, 10.9, 10.0, rules)  # 0.9 m/s after 10 s
    assert not adheres_again(smoothed, 0, 11.1, 10.0, rules)
    smoothed["matched_mps2"] = 0.6
    assert not adheres_again(smoothed, 0, 10.0, 10.0, rules)


def test_the_jerk_test_at_re_adhesion_is_a_switch() -> None:
    smoothed = calm(1)
    smoothed["jerk_wheel"] = 0.5
    assert adheres_again(smoothed, 0, 0.0, 10.0, rules_of(PaperSettings(), VEHICLE))
    assert not adheres_again(smoothed, 0, 0.0, 10.0, rules_of(PaperSettings(jerk_at_readhesion=True), VEHICLE))
