from __future__ import annotations

import numpy as np
import pytest

from services.byte_source.settings import TcpSource
from services.motion_sensors.imu_blocks import ImuBlocks
from services.motion_sensors.imu_sample import STANDARD_GRAVITY_MPS2, ImuSample
from services.motion_sensors.log_playback import blocks_of
from services.motion_sensors.settings import AxleInput, ImuInput
from services.motion_sensors.tacho_blocks import TachoBlocks
from services.odometry_fusion.motion_log import MotionLog

TCP = TcpSource(host="127.0.0.1", port=1)
RANDOM = np.random.default_rng(8)


def noisy(*mean: float) -> tuple[float, ...]:
    return tuple((np.array(mean) + RANDOM.normal(0.0, 0.01, 6)).tolist())


def test_samples_travel_in_vehicle_axes_with_their_own_times() -> None:
    blocks = ImuBlocks(ImuInput(tcp=TCP, axes=("x", "-y", "-z"), latency_s=0.05), block_s=0.1, counter_modulus=256)
    made = [
        blocks.take(ImuSample((0.1 * k, 1.0, -9.8, 0.0, 0.2, -0.3), counter=k % 256), 1000.0 + 0.01 * k)
        for k in range(31)
    ]
    messages = [one for one in made if one is not None]
    assert [one.first_sample for one in messages] == [0, 10, 20]
    first = messages[0]
    assert first.t_ns == pytest.approx((1000.0 + 0.09 - 0.05) * 1e9, abs=1e6)
    assert first.offset_ns == pytest.approx(np.arange(-9, 1) * 10_000_000, abs=20_000)
    assert first.ax_mps2 == pytest.approx(0.1 * np.arange(10))
    assert first.ay_mps2 == pytest.approx(np.full(10, -1.0))
    assert first.az_mps2 == pytest.approx(np.full(10, 9.8))
    assert first.gz_radps == pytest.approx(np.full(10, 0.3))


def test_a_hole_in_the_count_ends_a_message() -> None:
    blocks = ImuBlocks(ImuInput(tcp=TCP), block_s=0.1, counter_modulus=65_536)
    made = [
        blocks.take(ImuSample(noisy(0, 0, 9.8, 0, 0, 0), counter=k), 0.01 * k) for k in (0, 1, 2, 30, 31, 32, 40, 41)
    ]
    messages = [one for one in made if one is not None]
    assert [(one.first_sample, len(one.ax_mps2)) for one in messages] == [(0, 3), (30, 3)]
    assert blocks.times.lost == 27 + 7


def test_after_a_gap_samples_are_neither_late_nor_frozen() -> None:
    blocks = ImuBlocks(ImuInput(tcp=TCP), 0.1, counter_modulus=1 << 16)
    said = set()
    for k in [*range(15), *range(315, 345)]:
        # Coarse counts: az is the same before and after.
        noise = (
            0.01 * (k % 3),
            0.01 * (k % 2),
            9.8 + 0.01 * (k % 2),
            0.001 * (k % 2),
            0.001 * (k % 3),
            0.001 * (k % 2),
        )
        blocks.take(ImuSample(noise, counter=k), 50.0 + 0.01 * k)
        said |= set(blocks.warnings)
    assert said == {"gap"}


def test_wrong_axes_are_said_at_rest_and_taken_back_when_right() -> None:
    upside_down = ImuBlocks(ImuInput(tcp=TCP), block_s=0.1)
    for k in range(400):
        upside_down.take(ImuSample(noisy(0, 0, -STANDARD_GRAVITY_MPS2, 0, 0, 0)), 0.01 * k)
    assert "on -z" in upside_down.warnings["axes"]
    right = ImuBlocks(ImuInput(tcp=TCP, axes=("x", "-y", "-z")), block_s=0.1)
    for k in range(400):
        right.take(ImuSample(noisy(0, 0, -STANDARD_GRAVITY_MPS2, 0, 0, 0)), 0.01 * k)
    assert right.warnings == {}


def test_a_wrong_sign_of_y_is_found_in_the_first_curve() -> None:
    """R400 at 25 m/s without cant, where y points right: the force across comes out against the yaw rate."""
    blocks = ImuBlocks(ImuInput(tcp=TCP), block_s=0.1)
    yaw = 25.0 / 250.0
    for k in range(300):
        if blocks.take(ImuSample(noisy(0, -3.9, STANDARD_GRAVITY_MPS2, 0, 0, yaw)), 0.01 * k) is not None:
            blocks.compare(25.0)
    assert "sign of the yaw rate" in blocks.warnings["axes"]


def test_saturated_samples_are_marked_in_their_message() -> None:
    blocks = ImuBlocks(ImuInput(tcp=TCP, accelerometer_range_mps2=40.0), block_s=0.1)
    made = [blocks.take(ImuSample(noisy(40.0, 0, 9.8, 0, 0, 0)), 0.01 * k) for k in range(12)]
    assert "saturated" not in blocks.warnings or "ax" in blocks.warnings["saturated"]
    assert any(one is not None and "ax at the end" in one.fault for one in made)


def axle(**changes: object) -> AxleInput:
    return AxleInput(**{"tcp": TCP, "vehicle": "conventional", **changes})  # type: ignore[arg-type]  # fields by name


def test_counts_travel_unwrapped_with_the_wheel() -> None:
    blocks = TachoBlocks(axle(counter_bits=8), block_s=0.1, largest_speed_mps=100.0)
    made = [blocks.take((250 + 7 * k) % 256, 5.0 + 0.1 * k) for k in range(10)]
    messages = [one for one in made if one is not None]
    assert [one.pulses.tolist() for one in messages] == [[7 * k] for k in range(9)]
    assert messages[0].wheel_diameter_m == 0.816
    assert messages[0].pulses_per_revolution == 90.0
    assert blocks.speed_mps == pytest.approx(70 * np.pi * 0.816 / 90.0, rel=1e-6)


def test_a_counter_mounted_the_other_way_round_counts_forward() -> None:
    blocks = TachoBlocks(axle(backwards=True), block_s=0.1, largest_speed_mps=100.0)
    for k in range(5):
        blocks.take(1000 - 3 * k, 0.1 * k)
    assert blocks.distance_m == pytest.approx(12 * np.pi * 0.816 / 90.0)


def test_wheels_must_be_known() -> None:
    with pytest.raises(ValueError, match="wheel_diameter_m, or a vehicle"):
        AxleInput(tcp=TCP)
    with pytest.raises(ValueError, match="none of conventional"):
        axle(vehicle="steam")


def test_a_log_is_played_sample_for_sample() -> None:
    imu_t_s = np.asarray(5.3 + 0.01 * np.arange(100), np.float64)
    tacho_t_s = np.asarray(5.05 + 0.1 * np.arange(10), np.float64)
    imu, pulses = RANDOM.normal(0.0, 1.0, (100, 6)), np.arange(10) * 9
    log = MotionLog(imu_t_s, imu, tacho_t_s, pulses, 90.0, 0.816, 0.3, 35.0)
    start_ns = 1_700_000_000 * 10**9
    blocks = list(blocks_of(log, 0.1, start_ns))
    assert [one.t_ns for one in blocks] == sorted(one.t_ns for one in blocks)
    from_imu = [one for one in blocks if hasattr(one, "ax_mps2")]
    from_tacho = [one for one in blocks if hasattr(one, "pulses")]
    assert np.concatenate([one.ax_mps2 for one in from_imu]) == pytest.approx(imu[:, 0])
    assert np.concatenate([one.pulses for one in from_tacho]).tolist() == pulses.tolist()
    # The latency is taken off: the first inertial sample was measured 50 ms before the first count.
    assert from_imu[0].t_ns + int(from_imu[0].offset_ns[0]) == start_ns
    assert from_tacho[0].t_ns + int(from_tacho[0].offset_ns[0]) == start_ns + 50_000_000
