from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from services.motion_sensors.axle_watch import STUCK_S, AxlePair, StuckWatch
from services.motion_sensors.imu_sample import STANDARD_GRAVITY_MPS2, ImuSample
from services.motion_sensors.imu_watch import FROZEN_S, ImuWatch
from services.motion_sensors.mounting import angles_rotation, axes_rotation, fault_at_rest, fault_in_curve

Floats = NDArray[np.float64]
RANDOM = np.random.default_rng(4)


def watch() -> ImuWatch:
    return ImuWatch(accelerometer_range_mps2=49.0, gyro_range_radps=5.0, interval_s=0.01)


def sample(**changes: float) -> ImuSample:
    values = dict(zip(("ax", "ay", "az", "gx", "gy", "gz"), RANDOM.normal(0.0, 0.01, 6).tolist(), strict=True))
    values["az"] += STANDARD_GRAVITY_MPS2
    values.update(changes)
    return ImuSample(tuple(values.values()))


def test_a_healthy_sensor_has_no_fault() -> None:
    at_work = watch()
    assert all(at_work.faults(sample(), 0.01 * k, 0.01 * k + 0.02) == {} for k in range(500))


def test_an_axis_that_stays_the_same_is_frozen_and_named() -> None:
    at_work = watch()
    found = [at_work.faults(sample(gz=0.02), 0.01 * k, 0.01 * k) for k in range(100)]
    first = next(k for k, one in enumerate(found) if "frozen" in one)
    assert first * 0.01 == pytest.approx(FROZEN_S, abs=0.02)
    assert "gz" in found[-1]["frozen"]


def test_a_value_at_the_end_of_the_range_is_saturated() -> None:
    assert "ax" in watch().faults(sample(ax=-49.0), 0.0, 0.0)["saturated"]


def test_gaps_and_lateness_are_said() -> None:
    at_work = watch()
    at_work.faults(sample(), 0.0, 0.0)
    assert "0.49 s" in at_work.faults(sample(), 0.5, 0.5)["gap"]
    assert "3.0 s late" in at_work.faults(sample(), 0.51, 3.51)["late"]


def test_accelerations_in_the_wrong_unit_are_noticed() -> None:
    assert "scale" in watch().faults(sample(az=9806.0), 0.0, 0.0)["noise"]


@pytest.mark.parametrize("axes", [("x", "-y", "-z"), ("-x", "-y", "z"), ("y", "-x", "z"), ("-z", "y", "x")])
def test_axes_turn_into_a_rotation(axes: tuple[str, str, str]) -> None:
    rotation = axes_rotation(axes)
    assert rotation @ rotation.T == pytest.approx(np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1.0)


@pytest.mark.parametrize("axes", [("x", "y", "-z"), ("x", "x", "z"), ("x", "y", "up")])
def test_axes_that_are_none_are_refused(axes: tuple[str, str, str]) -> None:
    with pytest.raises(ValueError, match=r"axis|axes"):
        axes_rotation(axes)


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_mounting_angles_are_taken_back(roll: float, pitch: float, yaw: float) -> None:
    rotation = angles_rotation(roll, pitch, yaw)
    assert rotation @ rotation.T == pytest.approx(np.eye(3))
    # A sensor pitched nose down by p (right-handed about y) sees gravity forward: z axis leans forward.
    leaning = angles_rotation(0.0, pitch, 0.0) @ np.array([-math.sin(pitch), 0.0, math.cos(pitch)])
    assert leaning == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)


def rest(direction: tuple[float, float, float]) -> tuple[Floats, Floats]:
    force = STANDARD_GRAVITY_MPS2 * np.array(direction) / np.linalg.norm(direction)
    return force + RANDOM.normal(0.0, 0.02, (200, 3)), RANDOM.normal(0.0, 0.002, (200, 3))


def test_gravity_tells_axes_at_rest() -> None:
    assert fault_at_rest(*rest((0.035, 0.1, 1.0))) == ""
    assert "on -z" in (fault_at_rest(*rest((0.0, 0.0, -1.0))) or "")
    assert "on y" in (fault_at_rest(*rest((0.0, 1.0, 0.0))) or "")


def test_a_running_train_is_not_at_rest() -> None:
    forces, rates = rest((0.0, 0.0, 1.0))
    assert fault_at_rest(forces + RANDOM.normal(0.0, 1.0, forces.shape), rates) is None
    assert fault_at_rest(forces, rates + 0.1) is None


def test_a_curve_tells_the_sign_of_y() -> None:
    # R300 at 17 m/s with 105 mm of cant on 1,067 mm gauge: 0.96 m/s² less 0.97 m/s².
    assert fault_in_curve(17.0, 0.0, 17.0 / 300.0) == ""
    assert fault_in_curve(17.0, 0.9, 17.0 / 300.0) == ""
    assert fault_in_curve(20.0, -2.6, 0.1) not in ("", None)
    assert fault_in_curve(17.0, -5.0, 0.001) is None


def test_a_counter_that_stands_still_in_a_shaking_vehicle_is_stuck() -> None:
    watcher = StuckWatch()
    assert watcher.fault(0, 0.01, 0.0) == ""
    assert all(watcher.fault(0, 0.012, 0.1 * k) == "" for k in range(200)), "standing is no fault"
    found = [watcher.fault(0, 0.4, 20.0 + 0.1 * k) for k in range(100)]
    assert found[round(STUCK_S / 0.1) + 2] != ""
    assert watcher.fault(1, 0.4, 31.0) == ""


def test_axles_out_of_step_are_told_by_the_kilometre() -> None:
    pair = AxlePair()
    assert all(pair.fault(10.0 * k, 10.06 * k) == "" for k in range(300)), "turned wheels differ a little"
    lame = AxlePair()
    found = [lame.fault(10.0 * k, 9.78 * k) for k in range(300)]
    assert "-2.2 %" in found[-1]
