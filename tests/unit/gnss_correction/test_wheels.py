"""Speed by the wheels: files, looking up, and the scale that Doppler teaches."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from schemas.gnss_time import WEEK_S
from services.gnss_correction.line_wheels import NO_WHEEL, Wheels
from services.gnss_correction.wheel_file import WheelFileError, read_wheel
from services.gnss_correction.wheel_speed import OLDEST_S, WheelScale, WheelSpeeds

HEADER = "gps_week,tow_s,speed_mps\n"


def test_a_table_is_read(tmp_path: Path) -> None:
    path = tmp_path / "wheel.csv"
    path.write_text(HEADER + "2000,604799.8,10\n2001,0.2,-11.5\n")
    wheels = read_wheel(path, 0.0)
    assert wheels.t_s.tolist() == [2000 * WEEK_S + 604_799.8, 2001 * WEEK_S + 0.2]
    assert wheels.at(2001 * WEEK_S + 0.3) == 11.5


def test_odometry_lines_count_from_the_first_epoch(tmp_path: Path) -> None:
    path = tmp_path / "input.txt"
    path.write_text("range3 0 1 2\nodom3 0 5.85 0 0 0 0 0.1\nrange3 0.2 1\n\nodom3 0.3 6.07 0 0\n")
    wheels = read_wheel(path, 1000.0)
    assert wheels.t_s.tolist() == [1000.0, 1000.3]
    assert wheels.speed_mps.tolist() == [5.85, 6.07]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "neither rows"),
        ("range3 0 1\n", "neither rows"),
        (HEADER, "neither rows"),
        ("a,b\n1,2\n", ":1: no column gps_week, tow_s, speed_mps"),
        (HEADER + "2000,1,x\n", ":2: speed_mps is 'x'"),
        (HEADER + "2000,1\n", ":2: speed_mps is ''"),
        (HEADER + "2000,2,1\n2000,1,1\n", ":3: time does not rise"),
        (HEADER + "2000,2,1e9\n", ":2: a speed of 1e"),
        ("odom3 0\n", ":1: odom3 without"),
        ("odom3 0 nan\n", ":1: speed is 'nan'"),
    ],
)
def test_what_is_no_wheel_file_is_named(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "wheel"
    path.write_text(text)
    with pytest.raises(WheelFileError, match=words) as raised:
        read_wheel(path, 0.0)
    assert str(path) in str(raised.value)


def test_a_speed_is_never_taken_from_the_future_nor_long_after() -> None:
    wheels = WheelSpeeds(np.array([10.0, 10.2]), np.array([5.0, 6.0]))
    assert math.isnan(wheels.at(9.9))
    assert wheels.at(10.1) == 5.0
    assert wheels.at(10.2 - 1e-6) == 6.0  # the same instant, written differently
    assert wheels.at(10.2 + OLDEST_S - 1e-6) == 6.0
    assert math.isnan(wheels.at(10.2 + OLDEST_S + 1e-6))


def test_the_scale_is_learnt_and_grows_certain() -> None:
    scale = WheelScale()
    first = scale.sigma
    for _ in range(5_000):
        scale.learn(19.6, 20.0, 0.2)
    # After 20 km the prior of 500 m and the memory of 3 km leave 0.98 to within a thousandth.
    assert scale.scale == pytest.approx(0.98, abs=1e-3)
    assert scale.sigma < first / 2


@pytest.mark.parametrize("doppler_mps", [10.0, 30.0, math.nan])
def test_slip_and_slide_teach_nothing(doppler_mps: float) -> None:
    scale = WheelScale()
    scale.learn(doppler_mps, 20.0, 0.2)
    assert scale.scale == 1.0


def test_slip_is_no_change_of_speed_and_a_start_has_no_direction() -> None:
    wheels = Wheels()
    assert math.isnan(wheels.change_mps(10.0, 0.2))
    assert wheels.change_mps(10.2, 0.2) == pytest.approx(0.2)
    assert math.isnan(wheels.change_mps(13.0, 0.2))
    assert wheels.measurement(2.0, 0.2, 0.0) is NO_WHEEL
    assert wheels.measurement(math.nan, 0.2, 5.0) is NO_WHEEL
    assert wheels.measurement(5.0, 0.2, 5.0)[0] == 5.0
