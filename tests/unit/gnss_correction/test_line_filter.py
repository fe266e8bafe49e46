"""The filter along a line, on measurements whose truth is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from services.gnss_correction.line_estimate import LineEstimate
from services.gnss_correction.line_filter import LineFilter
from services.line.axis import Axis
from tests.unit.gnss_correction.made_up_line import RULES_HERE, bend, rows_at, there_and_back

BEND, LOOP = bend(), there_and_back()
SPEED_MPS = 15.0
STEP_S = 0.2


def run(
    axis: Axis,
    start_m: float,
    speed_mps: float,
    seconds: float,
    *,
    follower: LineFilter | None = None,
    aside_m: float = 0.0,
    clock_m: Callable[[float], float] = lambda t_s: 100.0 + 3.0 * t_s,
    extra_m: np.ndarray | float = 0.0,
    dark: tuple[float, float] = (0.0, 0.0),
    wheel: float = np.nan,
) -> tuple[list[LineEstimate], np.ndarray]:
    """Estimates and true places of a train at constant speed, `dark` without satellites."""
    follower = follower or LineFilter(axis)
    estimates, truth = [], []
    for t_s in np.arange(0.0, seconds, STEP_S).tolist():
        axis_m = start_m + speed_mps * t_s
        tangent, point = axis.tangent(axis_m), axis.at(axis_m)
        left = np.cross(point / np.linalg.norm(point), tangent)
        place = point + aside_m * left
        rows = rows_at(
            place,
            speed_mps * tangent,
            clock_m=clock_m(t_s),
            drift_mps=3.0,
            extra_m=extra_m,
            count=0 if dark[0] <= t_s < dark[1] else 10,
        )
        estimates.append(follower.epoch(t_s, 200_000.0, rows, RULES_HERE[0], place, wheel_mps=wheel * abs(speed_mps)))
        truth.append(axis_m)
    return estimates, np.array(truth)


def errors(estimates: list[LineEstimate], truth: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(np.array([one.axis_m for one in estimates]) - truth))


def test_without_errors_the_place_is_found_within_the_grid() -> None:
    estimates, truth = run(BEND, 300.0, SPEED_MPS, 30.0)
    assert all(one.status == "fix" for one in estimates)
    # The first epoch alone leaves 3 m of standard deviation over 10 satellites, and robust costs are flat there.
    assert errors(estimates, truth)[0] < 5.0
    assert errors(estimates, truth)[10:].max() < 1.0
    # Tangents of the polyline differ from its chords by up to its steps' angle, 1 degree: 0.02 %.
    assert abs(estimates[-1].speed_mps - SPEED_MPS) < 0.05
    assert np.median([one.bound_m for one in estimates]) < 15.0


def test_running_the_other_way_has_a_negative_speed() -> None:
    estimates, truth = run(BEND, 1500.0, -SPEED_MPS, 10.0)
    assert errors(estimates, truth)[10:].max() < 1.0
    assert estimates[-1].speed_mps == pytest.approx(-SPEED_MPS, abs=0.05)


@pytest.mark.parametrize("rising", [True, False])
def test_both_passages_stay_until_the_measurements_decide(rising: bool) -> None:  # noqa: FBT001 - a parameter
    # Eastwards on ground that the line passes twice: along its rising passage at 50 m, or against the
    # later one. The rising one goes round the loop in the end, the other straight on to the west's end.
    later_m = LOOP.length_m - 660.0
    estimates, truth = run(LOOP, 50.0, 12.0, 35.0) if rising else run(LOOP, later_m, 12.0, 35.0)
    wrong = errors(estimates, truth)
    bounds = np.array([one.bound_m for one in estimates])
    assert (wrong <= bounds).all()
    if rising:
        # The passages lie 4 m apart: in the beginning either may be meant, and the bound says so.
        assert bounds[0] > 500.0
    assert wrong[-1] < 2.0
    assert bounds[-1] < 20.0


def test_a_train_on_the_later_passage_is_not_vouched_for_on_the_earlier() -> None:
    # Westwards past the point where the early passage begins: only there does it become certain.
    start_m = LOOP.length_m - 880.0
    estimates, truth = run(LOOP, start_m, 12.0, 60.0)
    assert (errors(estimates, truth) <= np.array([one.bound_m for one in estimates])).all()
    assert errors(estimates, truth)[-1] < 2.0


@pytest.mark.parametrize("aside_m", [120.0, -400.0, 3_000.0])
def test_a_train_beside_the_line_gets_no_chainage(aside_m: float) -> None:
    estimates, _ = run(BEND, 300.0, SPEED_MPS, 20.0, aside_m=aside_m)
    assert all(one.status == "none" and np.isnan(one.axis_m) for one in estimates[25:])
    assert estimates[-1].reason.startswith("not on the line")


def test_a_train_that_comes_onto_the_line_is_followed_again() -> None:
    follower = LineFilter(BEND)
    away, _ = run(BEND, 300.0, SPEED_MPS, 12.0, aside_m=500.0, follower=follower)
    assert away[-1].status == "none"
    estimates, truth = [], []
    for t_s in np.arange(12.0, 60.0, STEP_S).tolist():
        axis_m = 300.0 + SPEED_MPS * t_s
        rows = rows_at(BEND.at(axis_m), SPEED_MPS * BEND.tangent(axis_m))
        estimates.append(follower.epoch(t_s, 200_000.0, rows, RULES_HERE[0]))
        truth.append(axis_m)
    # The disagreement is averaged over 10 s, and the line searched again every 10 s.
    assert all(one.status == "fix" for one in estimates[150:])
    assert errors(estimates[150:], np.array(truth[150:])).max() < 1.0


@pytest.mark.parametrize(("dark_s", "speed_mps"), [(10.0, 15.0), (600.0, 2.0)])
def test_a_tunnel_is_predicted_with_a_growing_bound(dark_s: float, speed_mps: float) -> None:
    dark = (20.0, 20.0 + dark_s)
    estimates, truth = run(BEND, 100.0, speed_mps, 25.0 + dark_s, dark=dark)
    inside = slice(round(dark[0] / STEP_S), round(dark[1] / STEP_S))
    assert all(one.status == "predicted" and "predicted for" in one.reason for one in estimates[inside])
    bounds = np.array([one.bound_m for one in estimates])
    assert (np.diff(bounds[inside]) >= 0.0).all()
    assert bounds[inside][-1] > bounds[inside][0] + 20.0
    assert (errors(estimates, truth) <= bounds).all()
    after = slice(inside.stop, None)
    assert all(one.status == "fix" for one in estimates[after])
    assert errors(estimates, truth)[-1] < 2.0


def test_wheels_carry_through_a_tunnel() -> None:
    # The wheels read 1 % too much: over 900 m in the dark that is 9 m, of which Doppler learnt some before.
    dark = (30.0, 90.0)
    with_wheels, truth = run(BEND, 100.0, SPEED_MPS, 90.0, dark=dark, wheel=1.01)
    without, _ = run(BEND, 100.0, SPEED_MPS, 90.0, dark=dark)
    assert errors(with_wheels, truth)[-1] < 9.0
    assert errors(with_wheels, truth)[-1] < with_wheels[-1].bound_m < 0.1 * without[-1].bound_m


def test_clock_jumps_are_absorbed() -> None:
    def jumping(t_s: float) -> float:
        return 3.0 * t_s + (299_792.458 if t_s > 5.0 else 0.0) - (1_000.0 if t_s > 8.0 else 0.0)

    estimates, truth = run(BEND, 300.0, SPEED_MPS, 12.0, clock_m=jumping)
    assert all(one.status == "fix" for one in estimates)
    assert errors(estimates, truth)[10:].max() < 2.0


def test_reflections_count_for_little() -> None:
    extra_m = np.array([80.0, 0.0, 45.0, 0.0, 0.0, 0.0, 60.0, 0.0, 0.0, 30.0])
    estimates, truth = run(BEND, 300.0, SPEED_MPS, 15.0, extra_m=extra_m)
    # Four of ten pseudoranges are 30 to 80 m too long; one epoch alone may be misled, the run is not.
    assert errors(estimates, truth)[25:].max() < 3.0
    assert (errors(estimates, truth) <= np.array([one.bound_m for one in estimates])).all()


def test_without_satellites_nothing_is_said() -> None:
    estimates, _ = run(BEND, 300.0, SPEED_MPS, 2.0, dark=(0.0, 9.0))
    assert all(one.status == "none" and one.reason for one in estimates)


def test_the_same_measurements_give_the_same_estimates() -> None:
    assert run(BEND, 300.0, SPEED_MPS, 4.0)[0] == run(BEND, 300.0, SPEED_MPS, 4.0)[0]
