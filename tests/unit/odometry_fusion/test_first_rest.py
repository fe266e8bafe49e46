"""A wheel that stands when odometry begins: at rest, or locked in a slide."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from services.odometry_fusion.first_rest import (
    FASTEST_MPS,
    SLOW_MPS,
    FirstRest,
    Rest,
    RestShaking,
    Shaking,
    limits_of,
)
from services.odometry_fusion.motion_log import Remembered
from services.odometry_fusion.odometry_store import read_state, state_file, write_state

SECOND_NS = 1_000_000_000
AT_REST = 0.006
UNDER_WAY = 0.15
"""Standard deviations of each axis' specific force [m/s²]; a hundredth of it for rates [rad/s]."""
KNOWN = Shaking(0.011, 1e-4)


class Train:
    """Samples of both sensors, a tenth of a second at a time: 100 Hz and 10 Hz."""

    def __init__(self, rest: FirstRest) -> None:
        self.rest = rest
        self.t_ns = 0
        self.way_m = 0.0
        self._generator = np.random.default_rng(1)

    def run(self, seconds: float, shaken: float, *, wheel_mps2: float = 0.0, force_mps2: float = 0.0) -> Rest:
        """So long, from the wheel's rest; says how it stands then, or as soon as it is over."""
        for k in range(round(seconds * 10)):
            t_ns = self.t_ns + np.arange(1, 11) * SECOND_NS // 100
            imu = self._generator.normal(0.0, 1.0, (10, 6)) * shaken * np.array([1.0] * 3 + [0.01] * 3)
            imu[:, 0] += force_mps2
            self.rest.take_imu(t_ns, imu)
            self.t_ns += SECOND_NS // 10
            self.way_m += wheel_mps2 * (k + 0.5) * 0.01
            self.rest.take_way("axle1", np.array([self.t_ns]), np.array([self.way_m]))
            if self.rest.state is Rest.OVER:
                break
        return self.rest.state


def test_a_quiet_sensor_is_at_rest_after_one_window() -> None:
    train = Train(FirstRest())
    assert train.run(0.9, AT_REST) is Rest.WAITING
    assert train.run(0.2, AT_REST) is Rest.SURE


def test_a_shaken_sensor_leaves_it_unsure_until_it_is_quiet() -> None:
    train = Train(FirstRest())
    assert train.run(12.0, UNDER_WAY) is Rest.UNSURE
    assert train.rest.unsure_since_ns == SECOND_NS // 100
    assert train.run(3.5, AT_REST) is Rest.OVER


def test_without_an_inertial_sensor_nothing_is_sure() -> None:
    rest = FirstRest()
    for k in range(20):
        rest.take_way("axle1", np.array([k * SECOND_NS // 10]), np.array([0.0]))
    assert rest.state is Rest.UNSURE


def test_a_wheel_that_turns_is_the_methods_own_affair() -> None:
    assert Train(FirstRest()).run(1.0, UNDER_WAY, wheel_mps2=10.0) is Rest.SURE


@pytest.mark.parametrize(
    ("known", "felt_mps2", "found"),
    [(KNOWN, 0.5, Rest.SURE), (KNOWN, 0.0, Rest.OVER), (None, 0.5, Rest.OVER)],
)
def test_a_departure_is_believed_if_the_sensor_feels_it_and_is_known(
    known: Shaking | None, felt_mps2: float, found: Rest
) -> None:
    train = Train(FirstRest(known))
    assert train.run(3.0, UNDER_WAY) is Rest.UNSURE
    assert train.run(6.0, UNDER_WAY, wheel_mps2=0.5, force_mps2=felt_mps2) is found


def test_a_sensor_of_which_nothing_is_known_tells_slow_from_fast() -> None:
    train = Train(FirstRest())
    # Three axes together 0.087 m/s²: a cheap sensor at rest, or a good one in a train at a few metres per second.
    assert train.run(3.0, 0.05) is Rest.UNSURE
    assert train.rest.fastest_mps == SLOW_MPS
    train.run(2.2, UNDER_WAY)
    assert train.rest.fastest_mps == FASTEST_MPS


def test_a_wheel_that_is_released_at_speed_is_no_departure() -> None:
    train = Train(FirstRest())
    train.run(3.0, UNDER_WAY)
    assert train.run(2.0, UNDER_WAY, wheel_mps2=20.0) is Rest.OVER


def test_what_a_vehicle_shows_at_rest_is_learned() -> None:
    learned = RestShaking()
    generator = np.random.default_rng(2)
    for k in range(200):
        imu = generator.normal(0.0, 1.0, (10, 6)) * UNDER_WAY * np.array([1.0] * 3 + [0.01] * 3)
        learned.take_imu((k * 10 + np.arange(1, 11)) * SECOND_NS // 100, imu, stands=True)
    assert learned.level is not None
    # Three axes together; a window of a hundred samples scatters by 4 %, the steps of the median by 5 %.
    assert learned.level.force_mps2 == pytest.approx(UNDER_WAY * np.sqrt(3.0), rel=0.15)
    assert Train(FirstRest(learned.level)).run(1.2, UNDER_WAY) is Rest.SURE
    assert Train(FirstRest(learned.level)).run(2.0, 3.0 * UNDER_WAY) is Rest.UNSURE
    quiet = limits_of(Shaking(0.001, 1e-5))
    # A good sensor in a quiet vehicle tells slow motion, but is not asked for more than any vehicle keeps.
    assert quiet == limits_of(Shaking(0.0, 0.0))
    assert not Shaking(0.05, 0.0).within(quiet)


def test_what_was_learned_outlives_a_restart(tmp_path: Path) -> None:
    known = Remembered(rest_mps2=0.2, rest_radps=3e-3)
    write_state(state_file(tmp_path, "demo", "T1"), 3, known)
    assert read_state(state_file(tmp_path, "demo", "T1")) == (3, known)


def test_samples_of_a_moving_train_teach_nothing() -> None:
    learned = RestShaking()
    learned.take_imu(np.arange(1, 301) * SECOND_NS // 100, np.ones((300, 6)), stands=False)
    assert learned.level is None


def test_a_train_that_is_pulled_along_after_a_rest_is_not_taken_to_stand() -> None:
    train = Train(FirstRest())
    assert train.run(30.0, AT_REST) is Rest.SURE
    assert train.run(2.0, UNDER_WAY) is Rest.SURE
    assert train.run(2.2, UNDER_WAY) is Rest.UNSURE
    assert train.rest.unsure_since_ns is not None
    assert 15.0 < train.rest.unsure_since_ns / SECOND_NS < 25.0
